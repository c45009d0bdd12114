"""What the doctor says of recorded frames: facts of a good recording, and each mistake by a sentence."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from void_layout import dataset, enlarge

from deux.data.dataset_reader import DatasetReader
from deux.doctor.frame_checks import SplitCheck, check_frames
from deux.geometry.poses import inverse
from deux_plugins.readers.rgbd_folder import RgbdFolder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Eight frames of two sequences each, in the training split alone."""
    return dataset(tmp_path / "video", triplets=False)


def train(reader: DatasetReader, previews: Path | None = None) -> SplitCheck:
    said: list[str] = []
    train, validation, test = check_frames(reader, previews=previews, show=said.append)
    assert (validation.frames, test.frames) == (0, 0)
    assert f"{reader.folder} has no validation split" in validation.facts[0]
    assert all(any(line.endswith(fact) for line in said) for fact in (*train.facts, *train.problems))
    return train


def test_a_good_recording_has_no_problems(folder: Path, tmp_path: Path) -> None:
    check = train(DatasetReader(folder), tmp_path / "previews")
    assert check.problems == []
    assert check.frames == 16
    facts = "\n".join(check.facts)
    assert "2 sequences" in facts
    assert "4 frames have no source frames at [-1, -2]: evaluated, but not trained on" in facts
    assert "48 x 40 pixels; focal length 24.0, 24.0, principal point 23.5, 19.5; field of view 90 x 80 degrees" in facts
    depths = [np.array(Image.open(file)) / 256 for file in sorted(folder.glob("data/*/ground_truth/*.png"))]
    assert f"{np.median(np.stack(depths)):.1f}" in facts.split("ground truth at")[1].split("m in the median")[0]
    assert check.warp is not None
    assert check.warp.warped < 0.5 * check.warp.identity
    assert check.preview == tmp_path / "previews/train.png"
    with Image.open(check.preview) as preview:
        assert len(np.unique(np.array(preview.convert("RGB")).reshape(-1, 3), axis=0)) > 100


def test_frames_count_as_trained_on_where_the_training_chooses_their_sources(folder: Path) -> None:
    """By parallax, the first frames of a sequence have source frames after them."""
    found = check_frames(DatasetReader(folder), show=lambda line: None, choice="baseline")
    assert not any("source frames" in fact for fact in found[0].facts)
    shutil.rmtree(folder / "data/hall-00/absolute_pose")
    found = check_frames(DatasetReader(folder), show=lambda line: None, choice="baseline")
    assert "2 frames have no source frames: evaluated, but not trained on" in found[0].facts


def test_the_motion_of_a_frame_is_that_of_its_pose(folder: Path) -> None:
    """The walk steps and turns by turns, so the median is between both."""
    poses = [np.loadtxt(file) for file in sorted(folder.glob("data/hall-00/absolute_pose/*.txt"))]
    steps = [np.linalg.norm(one[:3, 3] - other[:3, 3]) for one, other in zip(poses[1:], poses, strict=False)]
    said = next(fact for fact in train(DatasetReader(folder)).facts if "the camera moves" in fact)
    assert min(steps) <= float(said.split()[3]) <= max(steps)


def spoil(folder: Path, what: str) -> dict[str, float]:
    """Make one mistake in a recording; the options of its reader."""
    if what == "unit":
        return {"scale": 1000.0}
    if what == "inverted":
        for file in folder.glob("data/*/absolute_pose/*.txt"):
            np.savetxt(file, inverse(np.vstack([np.loadtxt(file), [0, 0, 0, 1]])))
    elif what == "camera":
        for file in folder.glob("data/*/K.txt"):
            np.savetxt(file, np.diag([1 / 48, 1 / 40, 1.0]) @ np.loadtxt(file))
    elif what == "no points":
        for file in folder.glob("data/hall-00/sparse_depth/*.png"):
            Image.fromarray(np.zeros((40, 48), np.uint16)).save(file)
    elif what == "truth":
        return {"ground_truth_scale": 5000.0}
    return {}


@pytest.mark.parametrize(
    ("what", "sentence"),
    [
        ("unit", "the depth holds 256 values per metre (metres x 256)"),
        ("inverted", "the depth are wrong: the poses are world-to-camera (error"),
        ("camera", "multiply its first row by the width 48 and its second row by the height 40."),
        ("no points", " of the 12 frames that were read have no sparse point."),
        ("truth", "the ground truth is 0.0512 times the sparse depth"),
    ],
)
def test_a_mistake_is_named(folder: Path, what: str, sentence: str) -> None:
    options = spoil(folder, what)
    assert any(sentence in problem for problem in train(DatasetReader(folder, **options)).problems)


def test_depth_is_judged_by_the_range_of_the_scenes(folder: Path) -> None:
    enlarge(folder)
    indoors, outdoors = (
        check_frames(DatasetReader(folder), depth_range=limits, show=lambda line: None)[0]
        for limits in ((0.1, 10.0), (1.0, 100.0))
    )
    (problem,) = indoors.problems
    assert problem.endswith("is the unit right, or max_depth=10 too small?")
    assert " within 0.1 to 10 m" in "\n".join(indoors.facts)
    assert outdoors.problems == []
    assert "100% within 1 to 100 m" in "\n".join(outdoors.facts)


@pytest.mark.parametrize("kind", ["ground_truth", "sparse_depth"])
def test_depth_of_another_size_than_the_image_is_a_problem(folder: Path, tmp_path: Path, kind: str) -> None:
    for file in folder.glob(f"data/hall-00/{kind}/*.png"):
        Image.open(file).resize((24, 20), Image.Resampling.NEAREST).save(file)
    check = train(DatasetReader(folder), tmp_path / "previews")
    (problem,) = check.problems
    assert re.fullmatch(
        rf"the {kind.replace('_', ' ')} of frame \d+ of hall-00 has 24 x 20 pixels and its image 48 x 40: depth "
        r"must be registered to the image, pixel by pixel \(6 of the 12 frames that were read\)\.",
        problem,
    )
    assert check.warp is not None, "the other sequence's depth fits"
    assert check.preview is not None


@pytest.mark.parametrize("kind", ["absolute_pose", "ground_truth"])
def test_what_is_not_there_is_a_fact_and_no_problem(folder: Path, tmp_path: Path, kind: str) -> None:
    for part in folder.glob(f"data/*/{kind}"):
        shutil.rmtree(part)
    check = train(DatasetReader(folder), tmp_path / "previews")
    assert check.problems == []
    assert check.warp is None
    sentence = {
        "absolute_pose": "no poses: train with pose=learned",
        "ground_truth": "no ground truth: no errors can be",
    }
    assert any(sentence[kind] in fact for fact in check.facts)
    assert check.preview is not None


def test_depth_without_a_point_gives_no_verdict_on_poses(folder: Path) -> None:
    for kind in ("ground_truth", "sparse_depth"):
        for file in folder.glob(f"data/*/{kind}/*.png"):
            Image.fromarray(np.zeros((40, 48), np.uint16)).save(file)
    check = train(DatasetReader(folder))
    assert check.problems == ["12 of the 12 frames that were read have no sparse point."]
    assert check.warp is None
    assert "no ground truth at any pixel of neighbouring frames: poses cannot be checked" in check.facts


def test_an_option_is_named_only_where_the_reader_has_it(folder: Path) -> None:
    video = folder.parent / "hall"
    for kind, name in (("image", "images"), ("sparse_depth", "sparse"), ("ground_truth", "depth")):
        shutil.copytree(folder / "data/hall-00" / kind, video / name)
    shutil.copy(folder / "data/hall-00/K.txt", video)
    for file in (video / "sparse").glob("*.png"):
        Image.fromarray(2 * np.array(Image.open(file))).save(file)
    options = {"scale": 256.0, "test": 0.0, "validation": 0.0}
    (problem,) = check_frames(RgbdFolder(video, **options), show=lambda line: None)[0].problems
    assert problem.endswith(
        "is 0.5 times the sparse depth at the points that both have (median): are both in one unit? "
        "data.sparse_scale sets the stored values per metre of the sparse points."
    )
    assert check_frames(RgbdFolder(video, sparse_scale=512.0, **options), show=lambda line: None)[0].problems == []


def test_single_frames_are_checked_as_far_as_they_go(tmp_path: Path) -> None:
    check = train(DatasetReader(dataset(tmp_path / "singles", frames=1, triplets=False)), tmp_path / "previews")
    assert check.problems == []
    assert check.frames == 2
    assert "no neighbouring frames: poses cannot be checked" in check.facts
