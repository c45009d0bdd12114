"""Samples: crops, augmentation, what is read and what is not."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torchvision.transforms import v2
from toy_world import CAMERA, ROOM, ToyScene, ToySimulator
from void_layout import dataset as written
from void_layout import write

from deux.contracts import Action, Augmentation, Batch, FrameReference, Triplet
from deux.data.dataset_reader import DatasetReader
from deux.data.frame_cache import FrameCache, MemoryCache
from deux.data.transforms import DropPoints
from deux.data.triplets import SampleSettings, TripletDataset, collate
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.reprojection import reproject
from deux.io.images import read_depth, write_depth, write_image
from deux.testing.readers import RecordedFrame

FULL = SampleSettings(ground_truth=True)
ALWAYS = (v2.RandomHorizontalFlip(p=1.0), DropPoints((0.3, 0.6), p=1.0))
BOTH = (v2.RandomHorizontalFlip(p=0.5), DropPoints((0.3, 0.6), p=0.5))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(tmp_path / "toy")


def load(folder: Path, settings: SampleSettings = FULL, cache: FrameCache | None = None) -> TripletDataset:
    return TripletDataset([DatasetReader(folder)], "train", settings, cache)


def first_triplet(folder: Path) -> Triplet:
    return DatasetReader(folder).triplets("train", (-1, -2))[0]


def file_of(folder: Path, kind: str, frame: FrameReference) -> Path:
    return folder / "data" / frame.sequence / kind / f"{frame.name}.png"


def test_an_item_is_what_the_files_hold(folder: Path) -> None:
    item, triplet = load(folder)[3], DatasetReader(folder).triplets("train", (-1, -2))[3]
    assert item.image.shape == (3, 40, 48)
    for pixels, frame in zip([item.image, *item.sources], [triplet.target, *triplet.sources], strict=True):
        stored = np.asarray(Image.open(file_of(folder, "image", frame)))
        np.testing.assert_allclose(pixels.permute(1, 2, 0).numpy() * 255, stored, atol=1e-3)
    np.testing.assert_array_equal(item.sparse_depth[0], read_depth(file_of(folder, "sparse_depth", triplet.target)))
    np.testing.assert_array_equal(item.validity[0], item.sparse_depth[0] > 0)
    np.testing.assert_array_equal(item.input_sparse_depth, item.sparse_depth)
    assert item.ground_truth is not None
    np.testing.assert_array_equal(item.ground_truth[0], read_depth(file_of(folder, "ground_truth", triplet.target)))
    np.testing.assert_allclose(item.intrinsics, [[24, 0, 23.5], [0, 24, 19.5], [0, 0, 1]], rtol=1e-6)


def photometric_error(item: Batch) -> float:
    """Median colour difference of the frame rebuilt from its sources with its true depth."""
    assert item.ground_truth is not None
    assert item.source_from_target is not None
    images, visible = reproject(
        item.sources[None], item.ground_truth[None], item.intrinsics[None], item.source_from_target[None]
    )
    error = (images - item.image).abs().mean(dim=2, keepdim=True)
    return float(error[visible & (item.ground_truth > 0)].median())


AUGMENTATIONS: dict[str, tuple[Augmentation, ...]] = {
    "none": (),
    "flip": (v2.RandomHorizontalFlip(p=1.0),),
    "upside_down": (v2.RandomVerticalFlip(p=1.0),),
    "crop": (v2.RandomCrop((20, 24)),),
    "resized_crop": (v2.RandomResizedCrop((30, 40), scale=(0.5, 1.0), antialias=False),),
    "pad_and_flip": (v2.Pad((3, 1, 2, 4), fill=7), v2.RandomHorizontalFlip(p=1.0)),
    "resize_and_crop": (v2.Resize((60, 64), antialias=False), v2.CenterCrop((41, 50))),
}


@pytest.mark.parametrize("crop", [None, (24, 32)])
@pytest.mark.parametrize("augmentation", AUGMENTATIONS.values(), ids=AUGMENTATIONS)
def test_images_depth_camera_and_motion_fit_each_other(
    folder: Path, augmentation: Sequence[Augmentation], crop: tuple[int, int] | None
) -> None:
    items = load(folder, SampleSettings(crop, training=True, ground_truth=True, augmentation=augmentation))
    for index in range(len(items)):
        item = items[index, index]
        assert photometric_error(item) < 0.03
        assert item.source_from_target is not None
        turned = replace(item, source_from_target=torch.linalg.inv(item.source_from_target))
        assert photometric_error(turned) > photometric_error(item)


class Focusing(DatasetReader):
    """Every other frame is of a camera with a narrower view and another principal point."""

    narrow = np.add(Camera(width=48, height=40, hfov=75.0).intrinsics, [[0, 0, 0], [0, 0, 2.0], [0, 0, 0]])

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        return self.narrow if int(frame.name) % 2 else super().intrinsics(frame)

    @classmethod
    def write(cls, folder: Path) -> Path:
        """A walk as both cameras see it: the second's image is cut out of one that is 4 pixels higher."""
        wide, narrow = (ToySimulator(ToyScene("hall", "toy-hall"), camera) for camera in (CAMERA, cls._higher()))
        wide.reset(ROOM[0, 0] + 1.0, 1.0, -0.6)
        frames = []
        for step in range(8):
            wide.step((Action.FORWARD, Action.LEFT)[step % 2])
            narrow.state = wide.state
            seen, rows = (narrow.observe(), slice(0, 40)) if step % 2 else (wide.observe(), slice(None))
            depth = seen.depth[rows]
            frames.append(RecordedFrame(seen.rgb[rows], depth, depth, CAMERA.intrinsics, seen.pose))
        return write(folder, {"hall-00": frames}, triplets=True)

    @staticmethod
    def _higher() -> Camera:
        return Camera(width=48, height=44, hfov=75.0)


@pytest.mark.parametrize("augmentation", AUGMENTATIONS.values(), ids=AUGMENTATIONS)
def test_source_frames_of_another_camera_fit_too(tmp_path: Path, augmentation: Sequence[Augmentation]) -> None:
    reader = Focusing(Focusing.write(tmp_path / "d"))
    settings = SampleSettings(training=True, ground_truth=True, augmentation=augmentation)
    items = TripletDataset([reader], "train", settings)
    for index in range(len(items)):
        item = items[index, index]
        assert photometric_error(item) < 0.03
        target, sources = reader.triplets("train", (-1, -2))[index]
        assert [int(frame.name) % 2 for frame in sources] != [int(target.name) % 2] * 2  # some are of the other camera


def test_a_training_crop_lies_at_random_and_moves_the_principal_point(folder: Path) -> None:
    whole, items = load(folder)[0], load(folder, SampleSettings((16, 20), training=True))
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


def test_crops_are_those_of_earlier_versions(folder: Path) -> None:
    """A training without random augmentation sees the same batches: numpy's generator draws the corner, row first."""
    whole, items = load(folder)[0], load(folder, SampleSettings((16, 20), training=True))
    for seed in range(5):
        rng = np.random.default_rng(seed)
        top, left = rng.integers(25), rng.integers(29)
        torch.testing.assert_close(items[0, seed].image, whole.image[:, top : top + 16, left : left + 20])


def test_an_evaluation_crop_is_the_middle(folder: Path) -> None:
    whole, item = load(folder)[0], load(folder, SampleSettings((16, 20), ground_truth=True))[0]
    torch.testing.assert_close(item.image, whole.image[:, 12:28, 14:34])
    assert whole.ground_truth is not None
    assert item.ground_truth is not None
    torch.testing.assert_close(item.ground_truth, whole.ground_truth[:, 12:28, 14:34])
    torch.testing.assert_close(item.intrinsics[:2, 2], whole.intrinsics[:2, 2] - torch.tensor([14.0, 12.0]))


def test_only_the_input_loses_points(folder: Path) -> None:
    settings = SampleSettings(training=True, augmentation=(DropPoints((0.3, 0.6), p=1.0),))
    item, plain = load(folder, settings)[0, 1], load(folder)[0]
    torch.testing.assert_close(item.sparse_depth, plain.sparse_depth)
    torch.testing.assert_close(item.validity, plain.validity)
    assert int((item.input_sparse_depth > 0).sum()) < int((plain.sparse_depth > 0).sum())


def test_evaluation_is_not_augmented(folder: Path) -> None:
    item, plain = load(folder, SampleSettings(augmentation=ALWAYS))[0], load(folder)[0]
    torch.testing.assert_close(item.input_sparse_depth, plain.sparse_depth)
    torch.testing.assert_close(item.image, plain.image)


def test_any_transform_of_colours_stays_between_0_and_1(folder: Path) -> None:
    jitter = (v2.ColorJitter(brightness=(0.5, 0.5)), v2.ToDtype(torch.float32, scale=True), v2.GaussianBlur(3))
    item, plain = load(folder, SampleSettings(training=True, augmentation=jitter))[0, 1], load(folder)[0]
    assert item.image.dtype == torch.float32
    torch.testing.assert_close(item.image.mean(), 0.5 * plain.image.mean(), rtol=0.02, atol=0.0)
    torch.testing.assert_close(item.sources.mean(), 0.5 * plain.sources.mean(), rtol=0.02, atol=0.0)
    torch.testing.assert_close(item.sparse_depth, plain.sparse_depth)


def test_the_model_prepares_from_the_points_that_it_is_shown(folder: Path) -> None:
    shown: list[np.ndarray] = []

    def prepare(sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        shown.append(sparse_depth)
        return {"scaffold": 2 * sparse_depth[None]}

    items = load(folder, SampleSettings((16, 20), training=True, augmentation=ALWAYS, prepare=prepare))
    batch = collate([items[0, 1], items[1, 2]])
    assert batch.prepared["scaffold"].shape == (2, 1, 16, 20)
    torch.testing.assert_close(batch.prepared["scaffold"], 2 * batch.input_sparse_depth)
    assert shown[0].dtype == np.float32


def test_equal_seeds_give_equal_items_and_leave_the_generators_alone(folder: Path) -> None:
    items = load(folder, SampleSettings((16, 20), training=True, augmentation=BOTH))
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    first, again, other = items[2, 7], items[2, 7], items[2, 8]
    torch.testing.assert_close(torch.rand(3), expected)
    torch.testing.assert_close(first.image, again.image)
    torch.testing.assert_close(first.input_sparse_depth, again.input_sparse_depth)
    assert not torch.equal(first.image, other.image)


def poison(folder: Path) -> None:
    for file in folder.iterdir():
        file.write_bytes(b"not for training")


@pytest.mark.parametrize("spoil", [shutil.rmtree, poison])
def test_ground_truth_is_not_touched_unless_asked_for(folder: Path, spoil: Callable[[Path], None]) -> None:
    before = [load(folder, SampleSettings())[i] for i in range(3)]
    for sequence in (folder / "data").iterdir():
        spoil(sequence / "ground_truth")
    after = [load(folder, SampleSettings())[i] for i in range(3)]
    for one, two in zip(before, after, strict=True):
        assert one.ground_truth is None
        assert two.ground_truth is None
        torch.testing.assert_close(one.sparse_depth, two.sparse_depth)
    with pytest.raises(DeuxError, match=r"ground_truth|has no ground truth"):
        load(folder)[0]


def test_a_dataset_without_ground_truth_is_named(tmp_path: Path) -> None:
    folder = written(tmp_path / "video", kinds=("image", "sparse_depth", "absolute_pose"))
    with pytest.raises(
        DeuxError, match=rf"^{folder} has no ground truth of hall-00: evaluation and supervised training"
    ):
        load(folder)[0]


def test_frames_need_no_poses(tmp_path: Path) -> None:
    posed = written(tmp_path / "posed")
    video = written(tmp_path / "video", kinds=("image", "sparse_depth", "ground_truth"))
    settings = SampleSettings((16, 20), training=True, ground_truth=True, augmentation=ALWAYS)
    item, same = load(video, settings)[3, 1], load(posed, settings)[3, 1]
    assert item.source_from_target is None
    assert collate([item, item]).source_from_target is None
    torch.testing.assert_close(item.image, same.image)
    torch.testing.assert_close(item.intrinsics, same.intrinsics)
    with pytest.raises(DeuxError, match="Some frames of one batch have poses and others have none"):
        collate([item, same])


def test_targets_without_source_frames_are_left_out_where_these_are_needed(tmp_path: Path) -> None:
    video = written(tmp_path / "video", triplets=False)  # eight frames of two sequences
    needed = load(video)
    assert len(needed) == 12
    assert collate([needed[i] for i in range(12)]).sources.shape == (12, 2, 3, 40, 48)
    every = load(video, replace(FULL, sources="unread", poses=False))
    assert [triplet.target.name for _, triplet in every.triplets[:8]] == [f"{i:06d}" for i in range(8)]
    batch = collate([every[i] for i in range(16)])
    assert batch.sources.shape == (16, 0, 3, 40, 48)
    assert batch.source_from_target is None
    torch.testing.assert_close(batch.image[2], needed[0].image)
    torch.testing.assert_close(every.with_sources(2).sources, needed[0].sources)
    torch.testing.assert_close(every.with_sources(2).source_from_target, needed[0].source_from_target)
    assert every.with_sources(0).sources.shape == (0, 3, 40, 48)


def test_a_dataset_of_single_frames_cannot_be_trained_on_where_source_frames_are_needed(tmp_path: Path) -> None:
    video = written(tmp_path / "video", triplets=False, frames=2)
    assert len(load(video, replace(FULL, sources="unread"))) == 4
    with pytest.raises(
        DeuxError,
        match=rf"^None of the 4 train frames of {video} has source frames: the frames at the offsets -1 and -2",
    ):
        load(video)


def test_poses_are_not_touched_unless_asked_for(folder: Path) -> None:
    before = load(folder)[0]
    for poses in (folder / "data").glob("*/absolute_pose"):
        poison(poses)
    item = load(folder, replace(FULL, poses=False))[0]
    assert item.source_from_target is None
    torch.testing.assert_close(item.sources, before.sources)
    with pytest.raises(DeuxError, match=r"absolute_pose/.* is not a text file of numbers"):
        load(folder)[0]


def test_a_truncated_file_is_named(folder: Path) -> None:
    file = file_of(folder, "image", first_triplet(folder).sources[1])
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(DeuxError, match=r"000000\.png is truncated"):
        load(folder)[0]


def test_a_map_of_another_size_is_named(folder: Path) -> None:
    write_depth(file_of(folder, "sparse_depth", first_triplet(folder).target), np.ones((10, 12)))
    with pytest.raises(
        DeuxError, match=r"frame 000002 of .* an image of 48 x 40 pixels and sparse depth of 12 x 10: they"
    ):
        load(folder)[0]


def test_a_source_frame_of_another_size_is_named(folder: Path) -> None:
    source = first_triplet(folder).sources[1]
    write_image(file_of(folder, "image", source), np.zeros((10, 12, 3), np.uint8))
    with pytest.raises(DeuxError, match=rf"image of 48 x 40 pixels and source frame {source.name} of 12 x 10: they"):
        load(folder)[0]


def test_a_crop_that_does_not_fit_is_an_error(folder: Path) -> None:
    with pytest.raises(
        DeuxError,
        match=r"has 48 x 40 pixels \(width x height\), too few for a crop of 32 x 64: reduce training\.crop\.$",
    ):
        load(folder, SampleSettings((64, 32)))[0]


def test_frames_of_several_sizes_need_a_crop(folder: Path) -> None:
    with pytest.raises(DeuxError, match="do not fit in one batch: set a crop"):
        collate([load(folder)[0], load(folder, SampleSettings((16, 20)))[0]])


def test_the_dataset_gives_the_same_with_a_cache_which_no_transform_reaches(folder: Path) -> None:
    def wipe(sample: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        for tensor in sample.values():
            tensor.zero_()
        return sample

    cache = MemoryCache(10**8)
    settings = SampleSettings((16, 20), training=True, ground_truth=True, augmentation=BOTH)
    spoilt = load(folder, replace(settings, augmentation=(wipe,)), cache)
    cached, plain = load(folder, settings, cache), load(folder, settings)
    cache.reserve(cached.keys, 10**7)
    for _ in range(2):
        for item in [(0, 1), (1, 2), (2, 3)]:
            assert float(spoilt[item].image.abs().sum()) == 0.0
            one, two = cached[item], plain[item]
            for name in ("image", "sources", "sparse_depth", "input_sparse_depth", "intrinsics", "source_from_target"):
                torch.testing.assert_close(getattr(one, name), getattr(two, name))


def test_equal_readers_share_the_cache(folder: Path) -> None:
    cache = MemoryCache(10**8)
    cache.reserve(load(folder, FULL).keys, 10**7)
    before = load(folder, FULL, cache)[0]
    for file in (folder / "data").rglob("*.png"):
        file.unlink()
    torch.testing.assert_close(load(folder, FULL, cache)[0].image, before.image)
