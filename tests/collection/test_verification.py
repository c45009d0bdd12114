"""Each reason for rejecting a frame."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from toy_world import ToySimulator

from deux.collection.sparse import SparseSettings, sample_sequences
from deux.collection.verification import Rejection, Verdict, VerificationSettings, verify_sequences
from deux.contracts import Action
from deux.io.calibration import write_matrix
from deux.io.frames import prepare_folders, write_frame
from deux.io.images import read_image, write_depth, write_image
from deux.io.layout import SequencePaths

SPARSE = SparseSettings(0.02)
FRAMES = 8


def walk(folder: Path, actions: list[Action]) -> SequencePaths:
    """A sequence of a robot that carries out the actions, sparse points included."""
    paths, simulator = SequencePaths(folder), ToySimulator()
    prepare_folders(paths, simulator.camera.intrinsics, labels=False)
    for index, action in enumerate(actions):
        write_frame(paths, index, simulator.observe())
        simulator.step(action)
    sample_sequences([paths], SPARSE)
    return paths


@pytest.fixture
def walked(tmp_path: Path) -> SequencePaths:
    return walk(tmp_path / "data/room", [Action.LEFT] * FRAMES)


def verdict(paths: SequencePaths, settings: VerificationSettings | None = None) -> dict[str, Rejection | None]:
    judged = verify_sequences([paths], settings or VerificationSettings(), SPARSE)[paths.name]["recent"]
    return {name: one.rejection for name, one in judged.items()}


def test_good_frames_pass_and_the_first_two_are_no_candidates(walked: SequencePaths) -> None:
    assert verdict(walked) == {f"{i:06d}": None for i in range(2, FRAMES)}


def fewer_points(paths: SequencePaths) -> None:
    one = np.zeros((40, 48))
    one[3, 4] = 1.0
    write_depth(paths.file("sparse_depth", "000004"), one)
    write_depth(paths.file("validity_map", "000004"), one)


def less_depth(paths: SequencePaths) -> None:
    little = np.zeros((40, 48))
    little[:4] = 2.0
    write_depth(paths.file("ground_truth", "000004"), little)


def cut_image(paths: SequencePaths) -> None:
    file = paths.file("image", "000004")
    file.write_bytes(file.read_bytes()[:200])


def cut_depth(paths: SequencePaths) -> None:
    file = paths.file("sparse_depth", "000004")
    file.write_bytes(file.read_bytes()[:50])


def broken_pose(paths: SequencePaths) -> None:
    paths.file("absolute_pose", "000004").write_text("nan " * 16)


def lost_validity(paths: SequencePaths) -> None:
    paths.file("validity_map", "000004").unlink()


def other_size(paths: SequencePaths) -> None:
    write_image(paths.file("image", "000004"), np.zeros((10, 12, 3), np.uint8))


def other_validity(paths: SequencePaths) -> None:
    write_depth(paths.file("validity_map", "000004"), np.ones((40, 48)))


def blank_image(paths: SequencePaths) -> None:
    file = paths.file("image", "000004")
    write_image(file, np.full_like(read_image(file), 160))


@pytest.mark.parametrize(
    ("damage", "reason", "frames"),
    [
        # What is wrong with the target alone costs that frame; one that is no source either costs the two after it.
        (fewer_points, Rejection.TOO_FEW_POINTS, [4]),
        (blank_image, Rejection.ONE_COLOR, [4]),
        (less_depth, Rejection.TOO_LITTLE_DEPTH, [4]),
        (cut_image, Rejection.UNREADABLE, [4, 5, 6]),
        (cut_depth, Rejection.UNREADABLE, [4, 5, 6]),
        (broken_pose, Rejection.UNREADABLE, [4, 5, 6]),
        (lost_validity, Rejection.INCONSISTENT, [4, 5, 6]),
        (other_size, Rejection.INCONSISTENT, [4, 5, 6]),
        (other_validity, Rejection.INCONSISTENT, [4, 5, 6]),
    ],
)
def test_each_reason(
    walked: SequencePaths, damage: Callable[[SequencePaths], None], reason: Rejection, frames: list[int]
) -> None:
    damage(walked)
    expected = {f"{i:06d}": reason if i in frames else None for i in range(2, FRAMES)}
    assert verdict(walked) == expected


def test_singular_intrinsics_cost_the_whole_sequence(walked: SequencePaths) -> None:
    write_matrix(walked.intrinsics, np.zeros((3, 3)))
    assert set(verdict(walked).values()) == {Rejection.INCONSISTENT}


def test_a_frame_must_have_moved_against_one_of_its_sources(tmp_path: Path) -> None:
    paths, simulator = SequencePaths(tmp_path / "data/room"), ToySimulator()
    prepare_folders(paths, simulator.camera.intrinsics, labels=False)
    for index, (x, yaw) in enumerate([(0, 0), (0, 0), (0, 0), (0.25, 0), (0.25, 0), (0.25, 0), (0.25, 0.2)]):
        simulator.reset(x, 0.0, yaw)
        write_frame(paths, index, simulator.observe())
    sample_sequences([paths], SPARSE)
    still = [name for name, reason in verdict(paths).items() if reason == Rejection.NO_MOTION]
    assert still == ["000002", "000005"]
    strict = VerificationSettings(min_distance=0.1, min_angle=360.0)
    still = [name for name, reason in verdict(paths, strict).items() if reason == Rejection.NO_MOTION]
    assert still == ["000002", "000005", "000006"]


def test_without_ground_truth_the_rest_is_still_judged(walked: SequencePaths) -> None:
    for file in (walked.folder / "ground_truth").iterdir():
        file.unlink()
    (walked.folder / "ground_truth").rmdir()
    fewer_points(walked)
    assert [reason for reason in verdict(walked).values() if reason] == [Rejection.TOO_FEW_POINTS]


def test_a_judged_sequence_is_read_again_only_for_other_settings(walked: SequencePaths) -> None:
    assert not any(verdict(walked).values())
    cut_image(walked)
    assert not any(verdict(walked).values())
    assert any(verdict(walked, VerificationSettings(min_depth=0.2)).values())


def by_baseline(paths: SequencePaths, every_frame: bool = True) -> Mapping[str, Verdict]:
    return verify_sequences([paths], VerificationSettings(), SPARSE, every_frame=every_frame)[paths.name]["baseline"]


def test_a_frame_that_stands_still_may_have_moved_against_its_sources_by_baseline(tmp_path: Path) -> None:
    """A step, three frames on the spot, a step: t-1 and t-2 teach the third of them nothing."""
    paths, simulator = SequencePaths(tmp_path / "data/room"), ToySimulator()
    prepare_folders(paths, simulator.camera.intrinsics, labels=False)
    for index, z in enumerate((0.5, 0.25, 0.25, 0.25, 0.0)):
        simulator.reset(0.0, z, 0.0)
        write_frame(paths, index, simulator.observe())
    sample_sequences([paths], SPARSE)
    assert verdict(paths)["000003"] == Rejection.NO_MOTION
    found = by_baseline(paths)
    assert list(found) == [f"{i:06d}" for i in range(5)]
    assert set(found["000003"].sources) == {"000000", "000004"}
    assert all(one.rejection is None and one.parallax for one in found.values())
    recent = verify_sequences([paths], VerificationSettings(), SPARSE)["room"]["recent"]
    assert {name: one.parallax for name, one in recent.items()} == {"000002": True, "000003": False, "000004": True}


def test_by_baseline_no_broken_frame_is_a_source(walked: SequencePaths) -> None:
    broken_pose(walked)
    found = by_baseline(walked)
    assert found["000004"].rejection == Rejection.UNREADABLE
    assert [name for name, one in found.items() if one.rejection] == ["000004"]
    assert all("000004" not in one.sources for one in found.values())


def test_the_first_frames_of_a_viewpoint_are_no_targets(walked: SequencePaths) -> None:
    assert list(by_baseline(walked, every_frame=False)) == [f"{i:06d}" for i in range(2, FRAMES)]


def test_verdicts_read_again_are_the_same(walked: SequencePaths) -> None:
    blank_image(walked)
    judged = verify_sequences([walked], VerificationSettings(), SPARSE)
    for file in (walked.folder / "image").iterdir():
        file.write_bytes(b"")
    assert verify_sequences([walked], VerificationSettings(), SPARSE) == judged
