"""What a training says: a bar in a terminal, lines in a file."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import RichProgressBar
from torch.utils.data import DataLoader

from deux.tasks.training_display import training_display


class Line(LightningModule):
    """Fits y = 2 x, and logs an error that tells its validation's number."""

    def __init__(self, validated: bool) -> None:
        super().__init__()
        self.slope = torch.nn.Parameter(torch.zeros(1))
        self.validated, self.validations = validated, 0

    def training_step(self, batch: torch.Tensor, _: int) -> torch.Tensor:
        return ((self.slope - 2) * batch).square().mean()

    def on_validation_epoch_start(self) -> None:
        self.validations += 1

    def validation_step(self, batch: torch.Tensor, _: int) -> None:
        if self.validated:
            self.log("validation/mae", 100.0 / self.validations)

    def configure_optimizers(self) -> Any:
        return torch.optim.SGD(self.parameters(), lr=0.1)


def train(folder: Path, bar: bool = False, validated: bool = True, **options: Any) -> Trainer:
    quiet = {"accelerator": "cpu", "logger": False, "enable_model_summary": False, "num_sanity_val_steps": 1}
    trainer = Trainer(
        default_root_dir=folder,
        enable_progress_bar=bar,
        enable_checkpointing=False,
        callbacks=[training_display(bar)],
        **quiet | options,
    )
    ones = DataLoader(torch.ones(4, 1), num_workers=0)  # type: ignore[arg-type]
    trainer.fit(Line(validated), ones, ones)
    return trainer


def test_each_validation_is_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train(tmp_path, max_steps=12)
    # The first of Lightning's validations is its check of the code, and says nothing.
    assert capsys.readouterr().out.splitlines() == [
        "  step 4 of 12, validation MAE 50.0 mm, 1 min left",
        "  step 8 of 12, validation MAE 33.3 mm, 1 min left",
        "  step 12 of 12, validation MAE 25.0 mm",
    ]


def test_a_training_without_a_number_of_steps_or_ground_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train(tmp_path, validated=False, max_epochs=-1, max_time={"seconds": 0.5})
    lines = capsys.readouterr().out.splitlines()
    assert all(re.fullmatch(r"  step [\d,]+", line) for line in lines)
    assert lines[:2] == ["  step 4", "  step 8"]


def test_a_bar_takes_the_place_of_the_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trainer = train(tmp_path, bar=True, max_steps=4)
    assert isinstance(trainer.progress_bar_callback, RichProgressBar)
    assert "step 4" not in capsys.readouterr().out


@pytest.mark.parametrize("bar", [False, True])
def test_an_end_before_the_last_step_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str], bar: bool) -> None:
    trainer = train(tmp_path, bar=bar, max_steps=10_000_000, max_time={"seconds": 0.5})
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(
        f"  the training ended after {trainer.global_step:,} of 10,000,000 steps, stopped by trainer.max_time"
    )


def test_the_end_of_a_training_in_epochs_is_no_early_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train(tmp_path, max_epochs=2)
    assert "ended" not in capsys.readouterr().out
