"""Samples: crops, augmentation, what is read and what is not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from toy_world import CAMERA, ToySimulator, Wanderer, specification

from deux.collection.pipeline import build_dataset
from deux.contracts import Action, Augmentation, Batch
from deux.data.reader import FileCache, read_split
from deux.data.triplets import SampleSettings, ShuffledDraws, TripletDataset, collate
from deux.errors import DeuxError
from deux.geometry.reprojection import reproject
from deux.io.calibration import write_matrix
from deux.io.images import read_depth, read_image, write_depth, write_image

FULL = SampleSettings(ground_truth=True)
DROP = Augmentation(drop_points=(0.3, 0.6))


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    spec = specification(sparse=replace(specification().sparse, density=0.05))
    return build_dataset(spec, tmp_path, ToySimulator, Wanderer)


def load(folder: Path, settings: SampleSettings = FULL, split: str = "train") -> TripletDataset:
    return TripletDataset([folder], split, settings)


def test_an_item_is_what_the_files_hold(dataset: Path) -> None:
    item, triplet = load(dataset)[3], read_split(dataset, "train")[3]
    frames = dataset / "data" / triplet.paths.name
    target = int(triplet.target)
    assert item.image.shape == (3, 40, 48)
    for pixels, index in zip([item.image, *item.sources], [target, target - 1, target - 2], strict=True):
        stored = read_image(frames / f"image/{index:06d}.png")
        np.testing.assert_allclose(pixels.permute(1, 2, 0).numpy() * 255, stored, atol=1e-3)
    np.testing.assert_array_equal(item.sparse_depth[0], read_depth(frames / f"sparse_depth/{triplet.target}.png"))
    np.testing.assert_array_equal(item.validity[0], item.sparse_depth[0] > 0)
    np.testing.assert_array_equal(item.input_sparse_depth, item.sparse_depth)
    assert item.ground_truth is not None
    np.testing.assert_array_equal(item.ground_truth[0], read_depth(frames / f"ground_truth/{triplet.target}.png"))
    np.testing.assert_allclose(item.intrinsics, CAMERA.intrinsics, rtol=1e-6)


def photometric_error(item: Batch) -> float:
    """Mean colour difference of the frame rebuilt from its sources with its true depth."""
    assert item.ground_truth is not None
    images, visible = reproject(
        item.sources[None], item.ground_truth[None], item.intrinsics[None], item.source_from_target[None]
    )
    error = (images - item.image).abs().mean(dim=2, keepdim=True)
    return float(error[visible].mean())


@pytest.mark.parametrize("crop", [None, (24, 32)])
@pytest.mark.parametrize("flip", [0.0, 1.0])
def test_images_depth_camera_and_motion_fit_each_other(
    dataset: Path, flip: float, crop: tuple[int, int] | None
) -> None:
    settings = SampleSettings(crop, training=True, ground_truth=True, augmentation=Augmentation(flip=flip))
    items = load(dataset, settings)
    for index in range(len(items)):
        item = items[index, index]
        assert photometric_error(item) < 0.03
        if not torch.allclose(item.source_from_target, torch.eye(4), atol=1e-3):
            turned = replace(item, source_from_target=torch.linalg.inv(item.source_from_target))
            assert photometric_error(turned) > photometric_error(item)


def test_a_flip_mirrors_pixels_principal_point_and_motion(dataset: Path) -> None:
    plain = load(dataset)[0]
    settings = SampleSettings(training=True, ground_truth=True, augmentation=Augmentation(flip=1.0))
    flipped = load(dataset, settings)[0, 0]
    torch.testing.assert_close(flipped.image, plain.image.flip(-1))
    torch.testing.assert_close(flipped.sparse_depth, plain.sparse_depth.flip(-1))
    assert flipped.intrinsics[0, 2] == 47 - plain.intrinsics[0, 2]
    point = torch.tensor([0.3, 0.2, 2.0, 1.0])
    mirrored = point * torch.tensor([-1.0, 1, 1, 1])
    moved = (plain.source_from_target @ point) * torch.tensor([-1.0, 1, 1, 1])
    torch.testing.assert_close(flipped.source_from_target @ mirrored, moved)


def test_a_training_crop_lies_at_random_and_moves_the_principal_point(dataset: Path) -> None:
    whole, items = load(dataset)[0], load(dataset, SampleSettings((16, 20), training=True))
    corners = set()
    for seed in range(30):
        item = items[0, seed]
        left, top = (whole.intrinsics - item.intrinsics)[:2, 2].round().int().tolist()
        torch.testing.assert_close(item.image, whole.image[:, top : top + 16, left : left + 20])
        torch.testing.assert_close(item.sources, whole.sources[:, :, top : top + 16, left : left + 20])
        torch.testing.assert_close(item.sparse_depth, whole.sparse_depth[:, top : top + 16, left : left + 20])
        corners.add((top, left))
    assert len(corners) > 20
    assert {top for top, _ in corners} <= set(range(25))


def test_an_evaluation_crop_is_the_middle(dataset: Path) -> None:
    whole, item = load(dataset)[0], load(dataset, SampleSettings((16, 20), ground_truth=True))[0]
    torch.testing.assert_close(item.image, whole.image[:, 12:28, 14:34])
    assert whole.ground_truth is not None
    assert item.ground_truth is not None
    torch.testing.assert_close(item.ground_truth, whole.ground_truth[:, 12:28, 14:34])
    torch.testing.assert_close(item.intrinsics[:2, 2], whole.intrinsics[:2, 2] - torch.tensor([14.0, 12.0]))


def test_only_the_input_loses_points_and_as_many_as_drawn(dataset: Path) -> None:
    items = load(dataset, SampleSettings(training=True, augmentation=DROP))
    plain = load(dataset)[0]
    fractions = []
    for seed in range(40):
        item = items[0, seed]
        torch.testing.assert_close(item.sparse_depth, plain.sparse_depth)
        torch.testing.assert_close(item.validity, plain.validity)
        left = item.input_sparse_depth > 0
        torch.testing.assert_close(item.input_sparse_depth[left], plain.sparse_depth[left])
        fractions.append(1 - float(left.sum() / (plain.sparse_depth > 0).sum()))
    assert 0.29 < min(fractions) < 0.36
    assert 0.54 < max(fractions) < 0.61


def test_evaluation_is_not_augmented(dataset: Path) -> None:
    settings = SampleSettings(augmentation=Augmentation(drop_points=(0.9, 1.0), flip=1.0))
    item, plain = load(dataset, settings)[0], load(dataset)[0]
    torch.testing.assert_close(item.input_sparse_depth, plain.sparse_depth)
    torch.testing.assert_close(item.image, plain.image)


def test_the_model_prepares_from_the_points_that_it_is_shown(dataset: Path) -> None:
    shown: list[np.ndarray] = []

    def prepare(sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        shown.append(sparse_depth)
        return {"scaffold": 2 * sparse_depth[None]}

    items = load(dataset, SampleSettings((16, 20), training=True, augmentation=DROP, prepare=prepare))
    batch = collate([items[0, 1], items[1, 2]])
    assert batch.prepared["scaffold"].shape == (2, 1, 16, 20)
    torch.testing.assert_close(batch.prepared["scaffold"], 2 * batch.input_sparse_depth)
    assert shown[0].dtype == np.float32


def test_equal_seeds_give_equal_items(dataset: Path) -> None:
    items = load(dataset, SampleSettings((16, 20), training=True, augmentation=Augmentation((0.3, 0.6), flip=0.5)))
    first, again, other = items[2, 7], items[2, 7], items[2, 8]
    torch.testing.assert_close(first.image, again.image)
    torch.testing.assert_close(first.input_sparse_depth, again.input_sparse_depth)
    assert not torch.equal(first.image, other.image)


def remove(folder: Path) -> None:
    for file in folder.iterdir():
        file.unlink()
    folder.rmdir()


def poison(folder: Path) -> None:
    for file in folder.iterdir():
        file.write_bytes(b"not for training")


@pytest.mark.parametrize("spoil", [remove, poison])
def test_ground_truth_is_not_touched_unless_asked_for(dataset: Path, spoil: Callable[[Path], None]) -> None:
    before = [load(dataset, SampleSettings())[i] for i in range(3)]
    for sequence in (dataset / "data").iterdir():
        spoil(sequence / "ground_truth")
    after = [load(dataset, SampleSettings())[i] for i in range(3)]
    for one, two in zip(before, after, strict=True):
        assert one.ground_truth is None
        assert two.ground_truth is None
        torch.testing.assert_close(one.sparse_depth, two.sparse_depth)
    with pytest.raises(DeuxError, match="ground_truth"):
        load(dataset)[0]


def test_a_truncated_file_is_named(dataset: Path) -> None:
    triplet = read_split(dataset, "train")[0]
    file = triplet.paths.file("image", triplet.sources[1])
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(DeuxError, match=r"000000\.png is truncated"):
        load(dataset)[0]


def test_singular_intrinsics_are_named(dataset: Path) -> None:
    triplet = read_split(dataset, "train")[0]
    write_matrix(triplet.paths.intrinsics, np.zeros((3, 3)))
    with pytest.raises(DeuxError, match=rf"{triplet.paths.name}/K\.txt does not hold"):
        load(dataset)[0]


def test_a_file_of_another_size_is_named(dataset: Path) -> None:
    triplet = read_split(dataset, "train")[0]
    write_depth(triplet.paths.file("sparse_depth", triplet.target), np.ones((10, 10)))
    with pytest.raises(DeuxError, match=r"sparse_depth/000002\.png has 10 x 10 pixels where .* 40 x 48"):
        load(dataset)[0]


def test_a_crop_that_does_not_fit_is_an_error(dataset: Path) -> None:
    with pytest.raises(DeuxError, match="crop of 64 x 32 does not fit in the 40 x 48 pixels"):
        load(dataset, SampleSettings((64, 32)))[0]


def test_frames_of_several_sizes_need_a_crop(dataset: Path) -> None:
    item = load(dataset)[0]
    with pytest.raises(DeuxError, match="do not fit in one batch: give a crop"):
        collate([item, load(dataset, SampleSettings((16, 20)))[0]])


def test_the_cache_reads_each_file_once_up_to_its_bound(tmp_path: Path) -> None:
    calls: list[Path] = []

    def reader(path: Path) -> np.ndarray:
        calls.append(path)
        return np.zeros(100, np.uint8)

    cache = FileCache(250)
    for _ in range(3):
        for name in ("a", "b", "c"):
            cache.read(Path(name), reader)
    assert calls == [Path("a"), Path("b"), Path("c"), Path("c"), Path("c")]


def test_the_dataset_gives_the_same_with_a_cache(dataset: Path) -> None:
    settings = SampleSettings((16, 20), training=True, augmentation=Augmentation((0.3, 0.6), flip=0.5))
    cached = TripletDataset([dataset], "train", settings, FileCache(10**8))
    for _ in range(2):
        for item in [(0, 1), (1, 2), (2, 3)]:
            torch.testing.assert_close(cached[item].image, load(dataset, settings)[item].image)
            torch.testing.assert_close(
                cached[item].input_sparse_depth, load(dataset, settings)[item].input_sparse_depth
            )


def test_draws_are_a_new_permutation_every_epoch() -> None:
    draws = ShuffledDraws(20, seed=5)
    first, again = list(draws), list(draws)
    draws.set_epoch(1)
    second = list(draws)
    assert first == again
    assert first != second
    assert sorted(index for index, _ in second) == list(range(20))
    assert not {seed for _, seed in first} & {seed for _, seed in second}
    assert list(ShuffledDraws(20, seed=5, epoch=1)) == second
    assert list(ShuffledDraws(20, seed=6)) != first


def test_shares_of_the_draws_are_equally_long_and_do_not_overlap() -> None:
    whole = list(ShuffledDraws(20, seed=5))
    shares = [ShuffledDraws(20, seed=5, share=share, shares=3) for share in range(3)]
    assert [len(share) for share in shares] == [len(list(share)) for share in shares] == [6, 6, 6]
    assert sorted(draw for share in shares for draw in share) == sorted(whole[:18])


def void_release(folder: Path, frames: int = 12) -> Path:
    """A folder as the release has it: names are time stamps, poses have three rows, some frames are listed."""
    sequence, simulator = folder / "void_1500/data/stairs", ToySimulator()
    for kind in ("image", "sparse_depth", "validity_map", "ground_truth", "absolute_pose"):
        (sequence / kind).mkdir(parents=True)
    write_matrix(sequence / "K.txt", simulator.camera.intrinsics)
    names = [f"15520979{i:02d}.{i:04d}" for i in range(frames)]
    for name in names:
        simulator.step(Action.FORWARD)
        frame = simulator.observe()
        write_image(sequence / f"image/{name}.png", frame.rgb)
        for kind in ("sparse_depth", "ground_truth"):
            write_depth(sequence / f"{kind}/{name}.png", frame.depth)
        np.savetxt(sequence / f"absolute_pose/{name}.txt", frame.pose[:3])
    lines = [f"void_1500/data/stairs/image/{name}.png\n" for name in names]
    (folder / "void_1500/train_image.txt").write_text("".join(lines))
    (folder / "void_1500/test_image.txt").write_text("".join(lines[4:6]))
    return folder / "void_1500"


def test_the_void_release_is_read_with_its_frame_offset(tmp_path: Path) -> None:
    release = void_release(tmp_path)
    found = read_split(release, "train", offsets=(-3, 3))
    assert [triplet.target[-4:] for triplet in found] == [f"{i:04d}" for i in range(3, 9)]
    assert [name[-4:] for name in found[0].sources] == ["0000", "0006"]
    assert [triplet.target[-4:] for triplet in read_split(release, "test", (-1, -2))] == ["0004", "0005"]
    item = TripletDataset([release], "train", FULL, offsets=(-3, 3))[0]
    assert photometric_error(item) < 0.05


def test_a_split_that_is_not_there_is_an_error(tmp_path: Path, dataset: Path) -> None:
    with pytest.raises(DeuxError, match=r"has no validation split.* it has test, train"):
        read_split(void_release(tmp_path), "validation")
    with pytest.raises(DeuxError, match="it has no list files at all"):
        read_split(tmp_path, "train")


def test_a_list_that_leads_elsewhere_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "train_image.txt").write_text("somewhere/else.png\n")
    with pytest.raises(DeuxError, match=r"lists somewhere/else\.png, where a path like data/<sequence>/image"):
        read_split(tmp_path, "train")
