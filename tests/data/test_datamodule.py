"""The data module under Lightning: order, workers, ground truth, frames that are added."""

import gc
import os
import resource
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lightning import Callback, LightningModule, Trainer
from lightning.fabric.utilities.apply_func import move_data_to_device
from torch import Tensor, nn
from torch.utils.data import get_worker_info
from torch.utils.data._utils.pin_memory import pin_memory
from torchvision.transforms import v2
from void_layout import dataset

from deux.contracts import Augmentation, Batch, DepthModel, Prediction
from deux.data.augmentation_settings import AugmentationSettings
from deux.data.chosen_sources import list_triplets
from deux.data.datamodule import TripletDataModule
from deux.data.dataset_reader import DatasetReader
from deux.data.device_cache import DeviceCache
from deux.data.frame_cache import FrameKey, MemoryCache
from deux.data.transforms import DropPoints
from deux.errors import DeuxError
from deux.registry import registry


class ToyModel(DepthModel):
    min_depth, max_depth = 0.1, 10.0

    def augmentation(self) -> Sequence[Augmentation]:
        return (v2.RandomHorizontalFlip(p=0.5), DropPoints((0.3, 0.6), p=0.5))

    def forward(self, image: Tensor, *_: Tensor, **prepared: Tensor) -> Prediction:
        return Prediction(image[:, :1])

    def prepare(self, sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        return {"double": 2 * sparse_depth[None]}


class SupervisedModel(ToyModel):
    supervised = True


class CountingModel(ToyModel):
    """Says which worker prepared a sample, and how many that worker had prepared before."""

    def __init__(self) -> None:
        super().__init__()
        self.prepared = 0

    def prepare(self, sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        worker = get_worker_info()
        assert worker is not None
        self.prepared += 1
        size = (1, *sparse_depth.shape)
        return {
            "worker": np.full(size, worker.id, np.float32),
            "before": np.full(size, self.prepared - 1, np.float32),
        }


class Unreachable:
    """Part of a cycle; writes down which process collects it."""

    def __init__(self, marks: Path) -> None:
        self.marks, self.myself = marks, self

    def __del__(self) -> None:
        (self.marks / str(os.getpid())).touch()


class CollectingModel(ToyModel):
    def prepare(self, sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        gc.collect()
        return {"worker": np.full((1, *sparse_depth.shape), os.getpid(), np.float32)}


class Recorder(LightningModule):
    """Trains nothing and keeps the batches."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(()))
        self.batches: list[Batch] = []
        self.validated: list[Batch] = []

    def training_step(self, batch: Batch, index: int) -> Tensor:
        self.batches.append(batch)
        return self.weight * batch.image.mean()

    def validation_step(self, batch: Batch, index: int) -> None:
        assert batch.ground_truth is not None
        self.validated.append(batch)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), 0.1)


def module(train: list[Path], model: DepthModel | None = None, **settings: Any) -> TripletDataModule:
    readers = [DatasetReader(folder) for folder in train]
    return TripletDataModule(model or ToyModel(), readers, batch_size=4, crop=(16, 20), seed=1, **settings)


def fit(data: TripletDataModule, epochs: int = 2, **settings: Any) -> Recorder:
    recorder = Recorder()
    trainer = Trainer(
        max_epochs=epochs,
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        log_every_n_steps=1,
        limit_val_batches=1.0 if data.validation else 0,
        **settings,
    )
    trainer.fit(recorder, datamodule=data)
    return recorder


def workers_of(batch: Batch) -> set[int]:
    return set(batch.prepared["worker"].flatten().tolist())


@pytest.mark.filterwarnings("ignore:.*does not have many workers")
def test_lightning_trains_on_it(tmp_path: Path) -> None:
    data = module([dataset(tmp_path / "d")])
    data.validation = [DatasetReader(dataset(tmp_path / "v", split="validation"))]
    batches = fit(data).batches
    assert len(batches) == 2 * (12 // 4)
    assert all(batch.image.shape == (4, 3, 16, 20) for batch in batches)
    assert all(batch.sources.shape == (4, 2, 3, 16, 20) for batch in batches)
    assert all(batch.ground_truth is None for batch in batches)
    assert all(torch.equal(batch.prepared["double"], 2 * batch.input_sparse_depth) for batch in batches)
    # The second epoch draws other crops than the first.
    assert not torch.equal(batches[0].intrinsics, batches[3].intrinsics)


@pytest.mark.filterwarnings("ignore:.*does not have many workers")
def test_reloading_the_loaders_changes_no_batch(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "d")
    kept, reloaded = fit(module([folder]), 3), fit(module([folder]), 3, reload_dataloaders_every_n_epochs=1)
    assert len(kept.batches) == 9
    for one, two in zip(kept.batches, reloaded.batches, strict=True):
        torch.testing.assert_close(one.image, two.image)
        torch.testing.assert_close(one.input_sparse_depth, two.input_sparse_depth)


@pytest.mark.filterwarnings("ignore:.*does not have many workers")
def test_the_same_workers_serve_all_epochs_until_the_datasets_change(tmp_path: Path) -> None:
    first, second = dataset(tmp_path / "first"), dataset(tmp_path / "second", frames=10)
    data = module([first], CountingModel(), num_workers=2)
    data.validation = [DatasetReader(dataset(tmp_path / "validation", split="validation"))]

    class Explore(Callback):
        def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
            if trainer.current_epoch == 1:  # an equal reader stands for the same dataset
                data.train = [DatasetReader(first), DatasetReader(second)]
            else:
                data.train = [DatasetReader(reader.folder) for reader in data.train]

    recorder = fit(data, 4, reload_dataloaders_every_n_epochs=1, callbacks=[Explore()])
    epochs = [recorder.batches[:3], recorder.batches[3:6], recorder.batches[6:13], recorder.batches[13:]]
    assert [len(epoch) for epoch in epochs] == [3, 3, 7, 7]
    earliest = [min(int(batch.prepared["before"].min()) for batch in epoch) for epoch in epochs]
    # A worker that is made anew begins to count again.
    assert earliest[0] == earliest[2] == 0
    assert earliest[1] >= 4
    assert earliest[3] >= 12
    assert {worker for epoch in epochs for batch in epoch for worker in workers_of(batch)} == {0, 1}
    assert min(int(batch.prepared["before"].min()) for batch in recorder.validated[3:]) >= 4


def drawn(data: TripletDataModule) -> list[Batch]:
    return list(data.train_dataloader())


def test_the_number_of_workers_changes_nothing(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "d")
    alone, together = module([folder]), module([folder], num_workers=2)
    for one, two in zip(drawn(alone) + drawn(alone), drawn(together) + drawn(together), strict=True):
        torch.testing.assert_close(one.image, two.image)
        torch.testing.assert_close(one.input_sparse_depth, two.input_sparse_depth)
        torch.testing.assert_close(one.intrinsics, two.intrinsics)


def test_what_was_unreachable_before_the_fork_is_not_freed_by_a_worker(tmp_path: Path) -> None:
    """CUDA graphs and tensors of an earlier training may be among it: freed in a fork they end the process."""
    data = module([dataset(tmp_path / "d")], CollectingModel(), num_workers=1)
    marks = tmp_path / "marks"
    marks.mkdir()
    gc.disable()
    try:
        Unreachable(marks)
        processes = {int(batch.prepared["worker"].flatten()[0]) for batch in drawn(data)}
        assert processes
        assert not {str(process) for process in processes} & set(os.listdir(marks))
    finally:
        gc.enable()
    gc.collect()
    assert os.listdir(marks) == [str(os.getpid())]


def test_ground_truth_reaches_supervised_models_alone(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "d")
    assert all(batch.ground_truth is not None for batch in drawn(module([folder], SupervisedModel())))
    for truth in (folder / "data").glob("*/ground_truth"):
        for file in truth.iterdir():
            file.write_bytes(b"poison")
    assert all(batch.ground_truth is None for batch in drawn(module([folder])))
    with pytest.raises(DeuxError, match="ground_truth"):
        drawn(module([folder], SupervisedModel()))


def test_frames_may_be_added_between_epochs(tmp_path: Path) -> None:
    data = module([dataset(tmp_path / "first")])
    assert len(data.train_dataloader().dataset) == 12  # type: ignore[arg-type]
    data.train.append(DatasetReader(dataset(tmp_path / "second")))
    assert len(data.train_dataloader().dataset) == 24  # type: ignore[arg-type]
    assert data.train_dataloader() is data.train_dataloader()


def test_a_last_batch_that_is_not_full_is_left_out_of_training_alone(tmp_path: Path) -> None:
    train, test = dataset(tmp_path / "d"), dataset(tmp_path / "t", split="test")
    data = TripletDataModule(ToyModel(), [DatasetReader(train)], test=[DatasetReader(test)], batch_size=5)
    assert [len(batch.image) for batch in data.train_dataloader()] == [5, 5]
    assert [len(batch.image) for batch in data.test_dataloader()] == [5, 5, 2]
    data.batch_size = 50
    assert [len(batch.image) for batch in data.train_dataloader()] == [12]


def test_evaluation_frames_come_in_order_and_whole(tmp_path: Path) -> None:
    reader = DatasetReader(dataset(tmp_path / "t", split="test"))
    (batch,) = TripletDataModule(ToyModel(), test=[reader], batch_size=12).test_dataloader()
    assert batch.image.shape == (12, 3, 40, 48)
    torch.testing.assert_close(batch.input_sparse_depth, batch.sparse_depth)
    assert batch.ground_truth is not None
    for truth, (target, _) in zip(batch.ground_truth, reader.triplets("test", (-1, -2)), strict=True):
        np.testing.assert_array_equal(truth[0], reader.ground_truth(target))


def test_evaluation_needs_no_poses_but_truth(tmp_path: Path) -> None:
    video = dataset(tmp_path / "video", split="test", kinds=("image", "sparse_depth", "ground_truth"))
    (batch,) = TripletDataModule(ToyModel(), test=[DatasetReader(video)], batch_size=12).test_dataloader()
    assert batch.source_from_target is None
    blind = dataset(tmp_path / "blind", split="test", kinds=("image", "sparse_depth"))
    with pytest.raises(DeuxError, match=rf"^{blind} has no ground truth of hall-00"):
        list(TripletDataModule(ToyModel(), test=[DatasetReader(blind)]).test_dataloader())


def test_the_test_set_has_every_listed_frame_and_reads_no_source_frame(tmp_path: Path) -> None:
    video = dataset(tmp_path / "video", split="test", triplets=False, kinds=("image", "sparse_depth", "ground_truth"))
    lines = (video / "test_image.txt").read_text().splitlines(keepends=True)
    (video / "test_image.txt").write_text("".join(lines[i] for i in (0, 3, 8, 15)))  # the first frame of each sequence
    whole = list(TripletDataModule(ToyModel(), test=[DatasetReader(video)], batch_size=3).test_dataloader())
    assert [batch.image.shape[0] for batch in whole] == [3, 1]
    assert all(batch.sources.shape[1] == 0 for batch in whole)
    for name in ("hall-00/image/000002.png", "hall-00/image/000001.png", "kitchen-00/image/000006.png"):
        (video / "data" / name).write_bytes(b"a source frame")
    again = list(TripletDataModule(ToyModel(), test=[DatasetReader(video)], batch_size=3).test_dataloader())
    torch.testing.assert_close(torch.cat([b.image for b in again]), torch.cat([b.image for b in whole]))


@pytest.mark.parametrize(("sources", "frames"), [(True, 12), (False, 16)])
def test_frames_without_source_frames_train_where_none_are_needed(tmp_path: Path, sources: bool, frames: int) -> None:
    video = dataset(tmp_path / "video", triplets=False)
    held_out = dataset(tmp_path / "held-out", split="validation", triplets=False)
    data = module([video], sources=sources)
    data.validation = [DatasetReader(held_out)]
    for loader in (data.train_dataloader(), data.val_dataloader()):
        assert len(loader.dataset) == frames  # type: ignore[arg-type]
        assert all(batch.sources.shape[1] == (2 if sources else 0) for batch in loader)


@pytest.mark.parametrize(
    ("sources", "poses", "scaled"),
    [(True, True, True), (False, False, True), pytest.param(True, False, False, id="poses that are learned")],
)
def test_scenes_are_scaled_where_the_way_between_the_frames_is_known(
    tmp_path: Path, sources: bool, poses: bool, scaled: bool
) -> None:
    settings = AugmentationSettings(own=False), AugmentationSettings(own=False, scale=(2.0, 2.0))
    readers = [DatasetReader(dataset(tmp_path / "a"))]
    plain, enlarged = (
        TripletDataModule(ToyModel(), readers, sources=sources, poses=poses, augmentation=one) for one in settings
    )
    before, after = (next(iter(data.train_dataloader())) for data in (plain, enlarged))
    torch.testing.assert_close(after.sparse_depth, (2.0 if scaled else 1.0) * before.sparse_depth)


def test_training_and_validation_take_the_chosen_source_frames(tmp_path: Path) -> None:
    """All eight frames of both sequences, where the first two of each lack t-1 or t-2."""
    video = dataset(tmp_path / "video", triplets=False)
    held_out = dataset(tmp_path / "held-out", split="validation", triplets=False)
    data = module([video], choice="baseline")
    data.validation = [DatasetReader(held_out)]
    for loader, folder, split in (
        (data.train_dataloader(), video, "train"),
        (data.val_dataloader(), held_out, "validation"),
    ):
        expected = list_triplets(DatasetReader(folder), split, "baseline")
        assert [triplet for _, triplet in loader.dataset.triplets] == expected  # type: ignore[attr-defined]
        assert len(expected) == 16
        assert sum(len(batch.sources) for batch in loader) == 16
        assert all(batch.sources.shape[1] == 2 for batch in loader)


@pytest.mark.parametrize("workers", [0, 1])
def test_a_truncated_file_is_one_sentence_whoever_reads_it(tmp_path: Path, workers: int) -> None:
    folder = dataset(tmp_path / "d")
    file = folder / "data/hall-00/image/000003.png"
    file.write_bytes(file.read_bytes()[:64])
    with pytest.raises(DeuxError) as caught:
        drawn(module([folder], num_workers=workers))
    assert str(caught.value) == f"{file} is truncated (64 bytes)."


@pytest.fixture
def few_files() -> Iterator[None]:
    """This process may open ten files more, and no others."""
    gc.collect()  # what other tests have left open and is closed meanwhile would be room
    least, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 10, most))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (least, most))


@pytest.mark.usefixtures("few_files")
def test_workers_that_can_open_too_few_files_are_refused_before_one_hangs(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "d")
    with pytest.raises(DeuxError, match=r"training.num_workers=1 needs 24 open files .* ulimit -n 1024"):
        drawn(module([folder], num_workers=1))
    assert drawn(module([folder], num_workers=0))


@pytest.mark.parametrize("poses", [True, False])
def test_batches_can_be_pinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, poses: bool) -> None:
    pinned: list[torch.Size] = []
    monkeypatch.setattr(Tensor, "pin_memory", lambda tensor: pinned.append(tensor.shape) or tensor)
    kinds = ("image", "sparse_depth", "ground_truth", "absolute_pose")
    (batch, *_) = drawn(module([dataset(tmp_path / "d", kinds=kinds if poses else kinds[:-1])]))
    assert pin_memory(batch) is batch
    assert len(pinned) == (8 if poses else 7)  # the batch's own tensors and the prepared one


@pytest.mark.parametrize("poses", [True, False])
def test_batches_can_be_moved_to_a_device(tmp_path: Path, poses: bool) -> None:
    kinds = ("image", "sparse_depth", "ground_truth", "absolute_pose")
    (batch, *_) = drawn(module([dataset(tmp_path / "d", kinds=kinds if poses else kinds[:-1])]))
    moved = move_data_to_device(batch, torch.device("meta"))
    for name in ("image", "sources", "sparse_depth", "validity", "intrinsics", "source_from_target"):
        if name != "source_from_target" or poses:
            assert getattr(moved, name).device.type == "meta"
    assert (moved.source_from_target is not None) == poses
    assert moved.prepared["double"].device.type == "meta"
    assert moved.ground_truth is None
    assert batch.image.device.type == "cpu"


class LeanModel(DepthModel):
    min_depth, max_depth = 0.1, 10.0
    augmentation = ToyModel.augmentation
    forward = ToyModel.forward


def batches_of(data: TripletDataModule, epochs: int = 2) -> list[Batch]:
    found = []
    for epoch in range(epochs):
        loader = data.train_dataloader()
        loader.sampler.set_epoch(epoch)  # type: ignore[union-attr]
        found += list(loader)
    return found


def assert_same(one: Sequence[Batch], two: Sequence[Batch]) -> None:
    assert len(one) == len(two) > 0
    for first, second in zip(one, two, strict=True):
        for name, value in vars(first).items():
            torch.testing.assert_close(getattr(second, name), value, rtol=0, atol=0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset(tmp_path_factory.mktemp("recorded") / "d")


@pytest.mark.parametrize("name", ["fusionnet", "kbnet", "scaffnet", "voiced"])
def test_samples_are_the_same_wherever_frames_are_kept_and_whoever_prepares_them(recorded: Path, name: str) -> None:
    with torch.device("meta"):
        model = registry().create("depth_models", name, {})
    expected = batches_of(module([recorded], model, cache="none", num_workers=0))
    assert len(expected) == 6
    assert not torch.equal(expected[0].image, expected[3].image)
    for cache, workers in (("device", None), ("memory", 0), ("auto", None), ("memory", 2), ("none", 2)):
        assert_same(batches_of(module([recorded], model, cache=cache, num_workers=workers)), expected)


def test_frames_are_read_once_by_all_workers_together(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "d")
    data = module([folder], cache="memory", num_workers=2)
    first = batches_of(data, 1)
    for file in (folder / "data").rglob("*.png"):
        file.write_bytes(b"read again")
    # The second epoch gives out what the first has read, whichever worker that was.
    again = batches_of(data, 1)
    assert_same(again, first)


@pytest.mark.parametrize("cache", ["device", "memory"])
def test_a_cache_takes_only_the_new_frames(tmp_path: Path, cache: str) -> None:
    old, new = dataset(tmp_path / "old"), dataset(tmp_path / "new")
    data = module([old], LeanModel(), cache=cache)
    before = batches_of(data, 1)
    assert len(before) == 3
    for file in (old / "data").rglob("*.png"):
        file.unlink()
    data.train.append(DatasetReader(new))
    both = batches_of(data, 1)  # does not read the old frames again
    assert len(both) == 6
    kept = data.train_dataloader().dataset.cache  # type: ignore[attr-defined]
    assert isinstance(kept, DeviceCache if cache == "device" else MemoryCache)
    data.train = [DatasetReader(new)]
    alone = module([new], LeanModel(), cache="none", num_workers=0)
    assert_same(batches_of(data, 1), batches_of(alone, 1))
    (out_of_use, *_) = DatasetReader(old).triplets("train", (-1, -2))
    assert not kept.holds(FrameKey(DatasetReader(old), "image", out_of_use.target))


@pytest.mark.parametrize("cache", ["device", "memory", "none"])
def test_an_epoch_goes_on_where_it_was(recorded: Path, cache: str) -> None:
    whole = batches_of(module([recorded], LeanModel(), cache=cache), 1)
    loader = module([recorded], LeanModel(), cache=cache).train_dataloader()
    batches = iter(loader)
    next(batches)
    state = loader.state_dict()
    resumed = module([recorded], LeanModel(), cache=cache).train_dataloader()
    resumed.load_state_dict(state)
    assert_same(list(resumed), whole[1:])


@pytest.mark.filterwarnings("ignore:.*does not have many workers")
@pytest.mark.parametrize("cache", ["device", "memory", "auto"])
def test_lightning_trains_and_validates_with_every_cache(recorded: Path, tmp_path: Path, cache: str) -> None:
    held_out = DatasetReader(dataset(tmp_path / "v", split="validation"))
    plain, cached = (module([recorded], LeanModel(), cache=one, num_workers=0) for one in ("none", cache))
    plain.validation, cached.validation = [held_out], [held_out]
    one, two = (fit(data, reload_dataloaders_every_n_epochs=1) for data in (plain, cached))
    assert_same(two.batches, one.batches)
    assert_same(two.validated, one.validated)


def test_what_the_model_prepares_on_the_cpu_is_not_made_on_the_device(
    recorded: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data = module([recorded], cache="device")
    with caplog.at_level("INFO", "deux"):
        assert_same(batches_of(data), batches_of(module([recorded], cache="none", num_workers=0)))
    assert isinstance(data.train_dataloader().dataset.cache, MemoryCache)  # type: ignore[attr-defined]
    assert [record.getMessage() for record in caplog.records] == [
        "ToyModel computes inputs on the CPU (prepare): frames are cached in memory and not on the device."
    ]


def test_only_part_of_the_frames_fits(recorded: Path) -> None:
    expected = batches_of(module([recorded], LeanModel(), cache="none", num_workers=0))
    for cache in ("device", "memory"):
        data = module([recorded], LeanModel(), cache=cache, num_workers=0, cache_bytes=40_000)
        assert_same(batches_of(data), expected)


def test_the_splits_share_what_is_free(recorded: Path, tmp_path: Path) -> None:
    held_out = DatasetReader(dataset(tmp_path / "v", split="validation"))
    sizes = {"train": 16 * 40 * 48 * 3 + 12 * 40 * 48 * 2, "validation": 16 * 40 * 48 * 3 + 12 * 40 * 48 * 4}
    data = module([recorded], LeanModel(), cache="device", cache_bytes=sizes["train"] + 1000)
    data.validation = [held_out]
    train, validation = data.train_dataloader(), data.val_dataloader()
    assert train.dataset.cache.capacity == sizes["train"] + 1000  # type: ignore[attr-defined]
    assert validation.dataset.cache.capacity == 1000  # type: ignore[attr-defined]
    list(train), list(validation)
    assert train.dataset.cache.size == sizes["train"]  # type: ignore[attr-defined]
    assert validation.dataset.cache.size == 0  # type: ignore[attr-defined]


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_a_card_keeps_frames_that_fit(recorded: Path) -> None:
    data = module([recorded], LeanModel())
    recorder = Recorder()
    trainer = Trainer(
        max_epochs=2,
        accelerator="gpu",
        devices=1,
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        limit_val_batches=0,
    )
    trainer.fit(recorder, datamodule=data)
    assert isinstance(data.train_dataloader().dataset.cache, DeviceCache)  # type: ignore[attr-defined]
    expected = fit(module([recorded], LeanModel(), cache="none", num_workers=0)).batches
    assert_same([move_data_to_device(batch, torch.device("cpu")) for batch in recorder.batches], expected)


@pytest.mark.parametrize(
    ("given", "told"), [(None, "None"), ([0.5], r"\[0\.5\]"), (v2.Identity(), r"Identity\(\)"), ({}, r"\{\}")]
)
def test_the_model_is_named_for_what_is_no_augmentation(tmp_path: Path, given: Any, told: str) -> None:
    class Odd(ToyModel):
        def augmentation(self) -> Sequence[Augmentation]:
            return given  # type: ignore[no-any-return]

    data = TripletDataModule(Odd(), [DatasetReader(dataset(tmp_path / "d"))], cache="none")
    sentence = f"^the `augmentation` of the depth model Odd gives {told}: it must be a tuple of transforms"
    with pytest.raises(DeuxError, match=sentence):
        data.train_dataloader()
