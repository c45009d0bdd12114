"""Batches that are made on a device equal those that are made from samples on the CPU, bit for bit on a CPU device."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves
from torchvision.transforms import v2
from void_layout import dataset

from deux.contracts import Augmentation, Batch
from deux.data.augmentation import RandomScale
from deux.data.dataset_reader import DatasetReader
from deux.data.device_batches import LoadedBatch
from deux.data.device_cache import DeviceCache, colors, cut_on_device, metres_on_device
from deux.data.frame_cache import metres
from deux.data.sample_parts import InputSparseDepth
from deux.data.transforms import DropPoints, augment_tensors, remove_points_on_device
from deux.data.triplets import SampleSettings, TripletDataset, collate
from deux.errors import DeuxError

CPU = torch.device("cpu")
TRAINING = SampleSettings((16, 20), training=True, ground_truth=True)
RANGE = (1.2, 4.5)
FLIPS = (v2.RandomHorizontalFlip(p=0.5), v2.RandomVerticalFlip(p=0.5))
AUGMENTATIONS: dict[str, Sequence[Augmentation]] = {
    "none": (),
    "points": (DropPoints((0.3, 0.6), p=0.8),),
    "flips and points": (*FLIPS, DropPoints((0.3, 0.6), p=0.8)),
    "points, flips and points": (DropPoints((0.3, 0.6), p=0.8), *FLIPS, DropPoints((0.0, 1.0), p=0.8)),
    "scale": (RandomScale((0.5, 1.5), RANGE),),
    "flips, scale and points": (*FLIPS, RandomScale((0.5, 1.5), RANGE), DropPoints((0.3, 0.6), p=0.8)),
    "scale and colours": (RandomScale((0.5, 1.5), RANGE), v2.ColorJitter(0.3, 0.3, 0.3), DropPoints((0.3, 0.6), p=0.8)),
    "colours": (v2.ColorJitter(0.3, 0.3, 0.3), v2.RandomGrayscale(0.3), v2.GaussianBlur(3)),
    "geometry": (v2.RandomCrop((12, 16)), v2.RandomResizedCrop((16, 16), antialias=True), DropPoints((0.5, 0.5), p=1)),
    "floats": (v2.RandomApply([v2.ToDtype(torch.float32, scale=True)], p=0.5),),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset(tmp_path_factory.mktemp("device") / "d")


def assert_equal(one: Batch, two: Batch) -> None:
    for name, value in vars(one).items():
        other = getattr(two, name)
        if isinstance(value, Tensor):
            assert value.dtype == other.dtype
            assert value.is_contiguous()
            assert other.is_contiguous()
            torch.testing.assert_close(value, other, rtol=0, atol=0, equal_nan=True)
        else:
            assert value == other


@pytest.mark.parametrize("as_on_a_card", [False, True])
@pytest.mark.parametrize("name", AUGMENTATIONS)
def test_every_augmentation_gives_the_same_batches(
    folder: Path, name: str, as_on_a_card: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if as_on_a_card:
        monkeypatch.setattr("deux.data.device_cache.cut_on_cpu", cut_on_device)
    settings = replace(TRAINING, augmentation=AUGMENTATIONS[name])
    readers = [DatasetReader(folder)]
    host = TripletDataset(readers, "train", settings)
    device = TripletDataset(readers, "train", settings, DeviceCache(CPU, 10**8))
    for start in range(0, 40, 4):
        items = [(index % len(host), 100 + index) for index in range(start, start + 4)]
        assert_equal(device.__getitems__(items), collate(host.__getitems__(items)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "settings",
    [SampleSettings(ground_truth=True), SampleSettings(sources="unread", poses=False), SampleSettings(poses=False)],
)
def test_evaluation_batches_are_the_same(folder: Path, settings: SampleSettings) -> None:
    readers = [DatasetReader(folder)]
    host, device = (TripletDataset(readers, "train", settings, c) for c in (None, DeviceCache(CPU, 10**8)))
    items = [5, 0, 11]
    assert_equal(device.__getitems__(items), collate(host.__getitems__(items)))  # type: ignore[arg-type]
    for one, two in ((device[3], host[3]), (device.with_sources(3), host.with_sources(3))):
        assert_equal(one, two)


def test_other_units_than_the_files_own_lose_nothing(folder: Path) -> None:
    readers = [DatasetReader(folder, scale=1000.0)]
    cache = DeviceCache(CPU, 10**8)
    host, device = (TripletDataset(readers, "train", TRAINING, c) for c in (None, cache))
    assert_equal(device.__getitems__([(0, 1), (4, 2)]), collate(host.__getitems__([(0, 1), (4, 2)])))  # type: ignore[arg-type]
    key = next(key for key in device.keys if key.kind == "sparse_depth")
    assert cache.read(key).dtype == torch.float32  # type: ignore[union-attr]


def test_depth_of_several_types_and_frames_that_are_not_kept_go_into_one_batch(folder: Path) -> None:
    millimetres, metres = DatasetReader(folder, scale=1000.0), DatasetReader(folder)
    host = TripletDataset([millimetres, metres], "train", TRAINING)
    items = [(11, 1), (20, 2), (0, 3), (12, 4), (11, 5)]
    expected = collate(host.__getitems__(items))  # type: ignore[arg-type]
    for capacity in (10**8, 9 * 3 * 40 * 48, 0):
        device = TripletDataset([millimetres, metres], "train", TRAINING, DeviceCache(CPU, capacity))
        for _ in range(2):
            assert_equal(device.__getitems__(items), expected)  # type: ignore[arg-type]
        assert device.cache.size <= capacity


class CountedOperations(TorchDispatchMode):
    """Counts the operations, and those among them that are work for the device, which views are not."""

    def __init__(self) -> None:
        super().__init__()
        self.all = self.on_device = 0

    def __torch_dispatch__(self, operation: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result = operation(*args, **(kwargs or {}))
        there = any(isinstance(one, Tensor) and one.is_meta for one in tree_leaves((args, kwargs, result)))
        makes_view = any(one.alias_info and not one.alias_info.is_write for one in operation._schema.returns)
        self.all += 1
        self.on_device += there and not makes_view
        return result


@pytest.mark.parametrize(
    ("name", "most", "per_sample"), [("none", 25, 0), ("flips", 25, 4), ("points", 40, 4), ("scale", 30, 4)]
)
def test_a_larger_batch_is_no_more_work_for_the_host_on_a_card(
    folder: Path, name: str, most: int, per_sample: int
) -> None:
    """Counted on torch's device without memory, whose tensors take the ways of a card's."""
    augmentation = {**AUGMENTATIONS, "flips": FLIPS, "points": (DropPoints((0.3, 0.6), p=1.0),)}[name]
    settings = replace(TRAINING, ground_truth=False, augmentation=augmentation)
    device = TripletDataset([DatasetReader(folder)], "train", settings, DeviceCache(torch.device("meta"), 10**8))
    device.__getitems__(range(12))
    launched = set()
    for size in (2, 4, 8, 12):
        with CountedOperations() as counted:
            device.__getitems__([(index, 7 * index) for index in range(size)])
        assert counted.all <= most + per_sample * size
        launched.add(counted.on_device)
    assert len(launched) == 1
    assert launched.pop() <= 10


def test_a_batch_that_is_on_the_device_stays_as_it_is(folder: Path) -> None:
    batch = TripletDataset([DatasetReader(folder)], "train", TRAINING, DeviceCache(CPU, 10**8)).__getitems__([0, 1])
    assert isinstance(batch, LoadedBatch)
    assert batch.to(CPU) is batch
    moved = batch.to(torch.device("meta"))
    assert all(value.is_meta for value in vars(moved).values() if isinstance(value, Tensor))
    assert not any(value.is_meta for value in vars(batch).values() if isinstance(value, Tensor))


def test_frames_that_do_not_fit_together_are_the_same_error(tmp_path: Path) -> None:
    readers = [DatasetReader(dataset(tmp_path / "whole")), DatasetReader(dataset(tmp_path / "no", kinds=KINDS))]
    device = TripletDataset(readers, "train", SampleSettings(), DeviceCache(CPU, 10**8))
    with pytest.raises(DeuxError, match="Some frames of one batch have poses and others have none"):
        device.__getitems__([0, 12])


KINDS = ("image", "sparse_depth")


def test_the_number_of_points_in_a_crop_is_known_on_the_host(folder: Path) -> None:
    cache = DeviceCache(CPU, 10**8)
    data = TripletDataset([DatasetReader(folder)], "train", replace(TRAINING, augmentation=FLIPS), cache)
    seen = []

    def look(sample: dict[str, Tensor]) -> dict[str, Tensor]:
        shown = sample["input_sparse_depth"]
        assert isinstance(shown, InputSparseDepth)
        seen.append((shown.points, int(torch.count_nonzero(shown))))
        return sample

    data.settings = replace(data.settings, augmentation=(*FLIPS, look, DropPoints((0.5, 0.5), p=1.0), *FLIPS, look))
    data.__getitems__([(index, index) for index in range(12)])
    assert len(seen) == 24
    assert all(known == counted for known, counted in seen)
    assert all(after[0] < before[0] for before, after in zip(seen[::2], seen[1::2], strict=True))


def test_points_are_removed_by_their_number_row_by_row() -> None:
    depth = torch.tensor([[0.0, 2.0, 0.0], [3.0, 0.0, 4.0]])
    removed = remove_points_on_device(depth, torch.tensor([2, 0]))
    assert removed.tolist() == [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]


def test_both_ways_to_remove_points_are_one(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    for share in (0.0, 0.02, 1.0):
        depth = torch.from_numpy(np.where(rng.random((30, 40)) < share, 2.0, 0.0).astype(np.float32))
        sample = {"images": torch.zeros(1, 3, 30, 40), "sparse_depth": depth, "intrinsics": torch.eye(3)}
        for seed in range(20):
            shown = augment_tensors(sample, [DropPoints((0.1, 0.9), p=0.9)], seed)["input_sparse_depth"]
            with monkeypatch.context() as patch:
                patch.setattr("deux.data.transforms._remove_points", remove_points_on_device)
                again = augment_tensors(sample, [DropPoints((0.1, 0.9), p=0.9)], seed)["input_sparse_depth"]
            assert torch.equal(shown, again)


def test_all_bytes_and_all_stored_depths_come_out_alike() -> None:
    code = np.arange(2**16, dtype=np.uint16).reshape(256, 256)
    assert torch.equal(metres_on_device(torch.from_numpy(code)), torch.from_numpy(metres(code)))
    gray = np.arange(256, dtype=np.uint8).reshape(1, 16, 16)
    np.testing.assert_array_equal(colors(torch.from_numpy(gray), torch.tensor(255.0)), gray / np.float32(255.0))


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("name", ["none", "points", "flips and points", "flips, scale and points"])
def test_a_card_makes_the_same_batches_and_nobody_waits_for_it(folder: Path, name: str) -> None:
    card = torch.device("cuda", 0)
    settings = replace(TRAINING, augmentation=AUGMENTATIONS[name])
    readers = [DatasetReader(folder)]
    host, device = (TripletDataset(readers, "train", settings, c) for c in (None, DeviceCache(card, 10**8)))
    for start in range(0, 40, 4):
        items = [(index % len(host), 100 + index) for index in range(start, start + 4)]
        mode = torch.cuda.get_sync_debug_mode()
        torch.cuda.set_sync_debug_mode("error")
        try:
            batch = device.__getitems__(items)
        finally:
            torch.cuda.set_sync_debug_mode(mode)
        assert isinstance(batch, Batch)
        assert batch.image.device == card
        moved = {key: value.cpu() if isinstance(value, Tensor) else value for key, value in vars(batch).items()}
        assert_equal(Batch(**moved), collate(host.__getitems__(items)))  # type: ignore[arg-type]
