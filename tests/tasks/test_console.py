import logging
import os
import warnings
from pathlib import Path

import pytest

from deux.metrics.tables import Cell, Column, ResultTable, Row
from deux.tasks import console
from deux.tasks.console import progress, quieten_libraries, quieten_trainer, say
from deux.training.fit import make_trainer

TRAINER = {"accelerator": "cpu", "logger": False, "enable_checkpointing": False}


@pytest.fixture
def machine_with_srun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slurm's command is installed, and this process is none of its jobs."""
    srun = tmp_path / "srun"
    srun.write_text("#!/bin/sh\n")
    srun.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")


def warned(quiet: bool) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if quiet:
            quieten_libraries()
        make_trainer(TRAINER)
    return [str(warning.message) for warning in caught if "srun" in str(warning.message)]


def test_a_machine_with_srun_is_no_reason_to_warn(machine_with_srun: None) -> None:
    assert len(warned(quiet=False)) == 1
    assert warned(quiet=True) == []
    make_trainer(TRAINER)  # the tests' own filter, in pyproject.toml


def test_the_trainer_logs_warnings_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    logger = logging.getLogger("lightning.pytorch")
    monkeypatch.setattr(logger, "level", logging.INFO)  # as Lightning's import leaves it
    quieten_trainer()
    assert not logger.isEnabledFor(logging.INFO)
    assert logger.isEnabledFor(logging.WARNING)


def test_no_heading_of_a_table_is_cut_short_in_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    headings = [f"heading{number:02}" for number in range(12)]
    table = ResultTable("caption", ("row",), tuple(map(Column, headings)), ((Row(("one",), (Cell(None),) * 12),),))
    say(table)
    said = capsys.readouterr().out
    assert [heading for heading in headings if heading not in said] == []


def test_long_work_that_nobody_watches_prints_a_line_a_minute(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr(console.time, "monotonic", lambda: now)
    with progress() as report:
        for done in range(0, 4001, 10):  # ten frames a second
            now = done / 10
            report("collection", done, 4000)
            report("verification", done // 2, 2000)  # another stage has lines of its own
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "  collection: 600 of 4,000, 6 min left"
    assert [line for line in lines if "verification" in line][-1] == "  verification: 1,800 of 2,000, 1 min left"
    assert len(lines) == 2 * 6  # 400 seconds; the end is told by what follows


def test_short_work_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress() as report:
        for done in range(101):
            report("collection", done, 100)
    assert capsys.readouterr().out == ""
