"""A training with active collection in a toy world that writes down every frame that it is shown.

    python active_run.py FOLDER [OPTIONS as JSON]

It is a program because some tests kill it, and some train it in two processes; see `train` for the options.
"""

import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from lightning.pytorch import Callback
from lightning.pytorch.utilities import rank_zero_only
from torch import Tensor, nn

sys.path.append(str(Path(__file__).resolve().parents[1] / "collection"))

from toy_world import L1, ToySimulator, guided_explorer, specification

from deux.collection.pipeline import build_dataset, read_manifest
from deux.contracts import DepthModel, LossSettings, Prediction
from deux.data.dataset_reader import DatasetReader
from deux.inference.precision import AUTOCAST
from deux.io.layout import sequences
from deux.training.active_collection import ActiveCollection, Collect
from deux.training.fit import fit
from deux.training.ranks import decided_by_leader, leads, wait_for_all
from deux.training.rounds import RankResult, RoundRequest, RoundSettings
from deux.training.training_settings import TrainingSettings


class Killed(BaseException):
    """Stands for a kill in tests that do not need a real one."""


class TinyModel(DepthModel):
    objective: ClassVar[LossSettings] = {"color_consistency": 1.0, "sparse_depth": 1.0}
    min_depth, max_depth = 0.1, 10.0

    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv2d(5, 1, 3, padding=1)
        self.frozen = nn.BatchNorm2d(1).eval().requires_grad_(False)

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        found = self.layer(torch.cat([image, sparse_depth, validity], dim=1))
        return Prediction((3.0 * found.float().exp()).clamp(self.min_depth, self.max_depth))

    def train(self, mode: bool = True) -> "TinyModel":
        super().train(mode)
        self.frozen.eval()
        return self


class Witness(Callback):
    """Appends a line to a file for each step: epoch, step, and the digest of each image that is shown."""

    def __init__(self, folder: Path, kill_at: int | None) -> None:
        self.folder, self.kill_at = folder, kill_at

    def on_train_batch_start(self, trainer: Any, pl_module: Any, batch: Any, batch_idx: int) -> None:
        if trainer.global_step == self.kill_at:
            raise Killed
        images = (batch.image * 255).round().byte().permute(0, 2, 3, 1).numpy()
        with (self.folder / f"seen{trainer.global_rank}.txt").open("a") as file:
            file.write(f"{trainer.current_epoch} {trainer.global_step} {' '.join(map(digest, images))}\n")


def digest(image: np.ndarray) -> str:
    """Sixteen hexadecimal digits for H x W x 3 uint8."""
    return hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest()[:16]


def dataset(root: Path, name: str, model: nn.Module, **changes: Any) -> Path:
    """What robots collect that a model guides; the dataset's name holds the model's weights."""
    weights = hashlib.sha256(
        b"".join(value.double().numpy().tobytes() for value in model.state_dict().values())
    ).hexdigest()
    spec = specification(name=name, model=weights, uncertainty=L1, **changes)
    return build_dataset(spec, root, ToySimulator, guided_explorer, model.predict)


def collect_in(root: Path, explorations: list[int]) -> Collect:
    """Collects the toy world's rounds, and counts them."""

    def collect(request: RoundRequest) -> RankResult:
        explorations.append(request.number)
        scenes = specification().scenes[request.rank :: request.world_size]
        dtype = AUTOCAST.get(request.precision)
        with torch.autocast("cpu", dtype, enabled=dtype is not None):
            changes = {"scenes": scenes, "seed": 100 + request.number}
            found = dataset(root, f"round{request.number}", request.model, **changes)
        count = read_manifest(found)["triplets"]
        return RankResult(found, count, area=len(sequences(found)), uncertainty=0.1 * (1 + request.rank), mae=None)

    return collect


def train(
    folder: Path,
    settings: dict[str, Any] | None = None,
    rounds: dict[str, Any] | None = None,
    trainer: dict[str, Any] | None = None,
    kill_at: int | None = None,
    collect: Collect | None = None,
    callbacks: Sequence[Callback] = (),
    validate: bool = False,
) -> tuple[DepthModel, ActiveCollection]:
    """Train, from where an earlier attempt in the folder was killed.

    Args:
        folder: takes everything.
        settings: of the training.
        rounds: of the rounds.
        trainer: arguments of Lightning's Trainer.
        kill_at: step at which `Killed` is raised.
        collect: collects the rounds; by default in the toy world.
        callbacks: further ones, after the active collection.
        validate: whether there are frames to validate on.
    """
    torch.set_num_threads(1)
    torch.manual_seed(0)
    model = TinyModel()
    first = dataset(folder / "rounds", "first", model)
    active = ActiveCollection(
        RoundSettings(**{"rounds": 2} | (rounds or {})),
        folder / "rounds",
        collect or collect_in(folder / "rounds", []),
    )
    quiet = {"accelerator": "cpu", "logger": False, "enable_progress_bar": False, "precision": "32-true"}
    fit(
        model,
        TrainingSettings(
            **{"batch_size": 4, "steps": 20, "learning_rate": 0.01, "checkpoint_minutes": 0.0, "sources": "recent"}
            | (settings or {})
        ),
        [DatasetReader(first)],
        [DatasetReader(dataset(folder, "held-out", model, split="validation"))] if validate else [],
        folder,
        trainer_arguments=quiet | (trainer or {}),
        callbacks=[Witness(folder, kill_at), active, *callbacks],
    )
    return model, active


def main(folder: Path, options: dict[str, Any]) -> None:
    """Train, and note what the leading process decided before and after it; another one would say the opposite."""
    told = [decided_by_leader(leads), decided_by_leader(lambda: not leads())]
    train(folder, **options)
    told += [decided_by_leader(lambda: not leads()), decided_by_leader(leads)]
    (folder / f"told{rank_zero_only.rank}.json").write_text(json.dumps({"told": told, "leads": leads()}))
    wait_for_all()


if __name__ == "__main__":
    main(Path(sys.argv[1]), json.loads(sys.argv[2] if len(sys.argv) > 2 else "{}"))
