"""What is there and what is missing: `python -m deux.doctor [--load] [option=value ...]`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from deux.errors import DeuxError
from deux.search_path import leave_out_working_folder

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from deux.doctor.checkup import Checkup


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the checks and return the exit code: 0, or 1 if something that was asked for is missing or wrong."""
    leave_out_working_folder()
    options = _parser().parse_args(arguments)
    try:
        return 1 if _run(options.overrides, options.load) else 0
    except DeuxError as error:
        print(f"deux: {error}", file=sys.stderr)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m deux.doctor",
        description="Say what is installed, which scenes and frames are on disk and what is missing, for a command "
        "with these options. Exit code 1: something that was asked for is missing.",
    )
    parser.add_argument(
        "overrides", nargs="*", metavar="option=value", help="of python -m deux, such as scenes=mp3d scenes.root=FOLDER"
    )
    parser.add_argument("--load", action="store_true", help="load the first scene and describe it")
    return parser


def _run(overrides: Sequence[str], load: bool) -> int:
    """Check all that the configuration asks for; the number of faults."""
    # Imported here because they bring torch, which `--help` must not wait for.
    from deux.composition_errors import quoted_digits
    from deux.configuration import compose
    from deux.doctor.checkup import Checkup
    from deux.doctor.installation_checks import check_installation
    from deux.doctor.scene_checks import check_scenes

    cfg = compose([quoted_digits(override) for override in overrides])
    checkup = Checkup()
    check_installation(checkup, cfg)
    check_scenes(checkup, cfg, load)
    for option, folder in (("training_data", cfg.training_data), ("evaluation.data", cfg.evaluation.data)):
        if folder is not None:
            _check_frames(checkup, cfg, option, folder)
    return checkup.faults


def _check_frames(checkup: Checkup, cfg: DictConfig, option: str, folder: str) -> None:
    """Check the recorded frames of a folder; previews are written below `paths.outputs`/doctor."""
    from deux.configuration import user_path
    from deux.contracts import Reader
    from deux.doctor.frame_checks import check_frames
    from deux.options import construct
    from deux.registry import registry
    from deux.tasks.console import say
    from deux.training.training_settings import TrainingSettings

    checkup.heading(f"Frames: {cfg.data.get('name')}, {option}={folder}")
    try:
        reader: Reader = registry().choose("readers", cfg.data).create(user_path(folder))
        checkup.fact("folder", str(reader.folder))
        offsets = construct(TrainingSettings, cfg.training, "training").offsets
        checks = check_frames(
            reader, offsets, user_path(cfg.paths.outputs) / "doctor", show=lambda line: say(f"  {line}")
        )
        checkup.faults += sum(len(check.problems) for check in checks)
        if not any(check.frames for check in checks):
            checkup.fault(f"{folder} has no frames in any split.")
    except DeuxError as error:
        checkup.fault(str(error))


if __name__ == "__main__":
    sys.exit(main())
