"""The data module under Lightning: order, workers, ground truth, frames that are added."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lightning import LightningModule, Trainer
from lightning.fabric.utilities.apply_func import move_data_to_device
from torch import Tensor, nn
from torch.utils.data._utils.pin_memory import pin_memory
from toy_world import ToySimulator, Wanderer, specification

from deux.collection.pipeline import build_dataset
from deux.contracts import Augmentation, Batch, DepthModel, Prediction
from deux.data.datamodule import TripletDataModule
from deux.data.reader import read_split
from deux.errors import DeuxError


class ToyModel(DepthModel):
    augmentation = Augmentation(drop_points=(0.3, 0.6), flip=0.5)
    min_depth, max_depth = 0.1, 10.0

    def forward(self, image: Tensor, *_: Tensor, **prepared: Tensor) -> Prediction:
        return Prediction(image[:, :1])

    def prepare(self, sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        return {"double": 2 * sparse_depth[None]}


class SupervisedModel(ToyModel):
    supervised = True


class Recorder(LightningModule):
    """Trains nothing and keeps the batches."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(()))
        self.batches: list[Batch] = []

    def training_step(self, batch: Batch, index: int) -> Tensor:
        self.batches.append(batch)
        return self.weight * batch.image.mean()

    def validation_step(self, batch: Batch, index: int) -> None:
        assert batch.ground_truth is not None

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), 0.1)


def build(root: Path, **changes: Any) -> Path:
    return build_dataset(specification(**changes), root, ToySimulator, Wanderer)


def module(train: list[Path], model: DepthModel | None = None, **settings: Any) -> TripletDataModule:
    return TripletDataModule(model or ToyModel(), train, batch_size=4, crop=(16, 20), seed=1, **settings)


def fit(data: TripletDataModule, epochs: int = 2, **settings: Any) -> list[Batch]:
    recorder = Recorder()
    trainer = Trainer(
        max_epochs=epochs,
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        log_every_n_steps=1,
        **settings,
    )
    trainer.fit(recorder, datamodule=data)
    return recorder.batches


@pytest.mark.filterwarnings("ignore:.*does not have many workers")
@pytest.mark.filterwarnings("ignore:.*isinstance.treespec, LeafSpec.*:FutureWarning")  # Lightning itself
def test_lightning_trains_on_it(tmp_path: Path) -> None:
    data = module([build(tmp_path)])
    data.validation = [build(tmp_path, split="validation")]
    batches = fit(data)
    assert len(batches) == 2 * (12 // 4)
    assert all(batch.image.shape == (4, 3, 16, 20) for batch in batches)
    assert all(batch.sources.shape == (4, 2, 3, 16, 20) for batch in batches)
    assert all(batch.ground_truth is None for batch in batches)
    assert all(torch.equal(batch.prepared["double"], 2 * batch.input_sparse_depth) for batch in batches)
    # The second epoch draws other crops than the first.
    assert not torch.equal(batches[0].intrinsics, batches[3].intrinsics)


def drawn(data: TripletDataModule) -> list[Batch]:
    return list(data.train_dataloader())


def test_the_number_of_workers_changes_nothing(tmp_path: Path) -> None:
    dataset = build(tmp_path)
    alone, together = drawn(module([dataset])), drawn(module([dataset], num_workers=2))
    for one, two in zip(alone, together, strict=True):
        torch.testing.assert_close(one.image, two.image)
        torch.testing.assert_close(one.input_sparse_depth, two.input_sparse_depth)
        torch.testing.assert_close(one.intrinsics, two.intrinsics)


def test_ground_truth_reaches_supervised_models_alone(tmp_path: Path) -> None:
    dataset = build(tmp_path)
    assert all(batch.ground_truth is not None for batch in drawn(module([dataset], SupervisedModel())))
    for folder in (dataset / "data").glob("*/ground_truth"):
        for file in folder.iterdir():
            file.write_bytes(b"poison")
    assert all(batch.ground_truth is None for batch in drawn(module([dataset])))
    with pytest.raises(DeuxError, match="ground_truth"):
        drawn(module([dataset], SupervisedModel()))


def test_frames_may_be_added_between_epochs(tmp_path: Path) -> None:
    data = module([build(tmp_path)])
    assert len(data.train_dataloader().dataset) == 12  # type: ignore[arg-type]
    data.train.append(build(tmp_path, seed=8))
    assert len(data.train_dataloader().dataset) == 24  # type: ignore[arg-type]


def test_a_last_batch_that_is_not_full_is_left_out_of_training_alone(tmp_path: Path) -> None:
    data = TripletDataModule(ToyModel(), [build(tmp_path)], test=[build(tmp_path, split="test")], batch_size=5)
    assert [len(batch.image) for batch in data.train_dataloader()] == [5, 5]
    assert [len(batch.image) for batch in data.test_dataloader()] == [5, 5, 2]
    data.batch_size = 50
    assert [len(batch.image) for batch in data.train_dataloader()] == [12]


def test_evaluation_frames_come_in_order_and_whole(tmp_path: Path) -> None:
    dataset = build(tmp_path, split="test")
    data = TripletDataModule(ToyModel(), test=[dataset], batch_size=12)
    (batch,) = data.test_dataloader()
    assert batch.image.shape == (12, 3, 40, 48)
    torch.testing.assert_close(batch.input_sparse_depth, batch.sparse_depth)
    assert batch.ground_truth is not None
    assert len(read_split(dataset, "test")) == 12


@pytest.mark.parametrize("workers", [0, 1])
def test_a_truncated_file_is_one_sentence_whoever_reads_it(tmp_path: Path, workers: int) -> None:
    dataset = build(tmp_path)
    file = dataset / "data/hall-00/image/000003.png"
    file.write_bytes(file.read_bytes()[:64])
    with pytest.raises(DeuxError) as caught:
        drawn(module([dataset], num_workers=workers))
    assert str(caught.value) == f"{file} is truncated or no PNG file (64 bytes)."


def test_batches_can_be_pinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pinned: list[torch.Size] = []
    monkeypatch.setattr(Tensor, "pin_memory", lambda tensor: pinned.append(tensor.shape) or tensor)
    (batch, *_) = drawn(module([build(tmp_path, sparse=replace(specification().sparse, density=0.05))]))
    assert pin_memory(batch) is batch
    assert len(pinned) == 8  # seven tensors and the prepared one


def test_batches_can_be_moved_to_a_device(tmp_path: Path) -> None:
    (batch, *_) = drawn(module([build(tmp_path)]))
    moved = move_data_to_device(batch, torch.device("meta"))
    for name in ("image", "sources", "sparse_depth", "validity", "intrinsics", "source_from_target"):
        assert getattr(moved, name).device.type == "meta"
    assert moved.prepared["double"].device.type == "meta"
    assert moved.ground_truth is None
    assert batch.image.device.type == "cpu"
