"""Checks of the installation and a configuration: `python -m deux.doctor [--load] [--json] [option=value ...]`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from deux.errors import DeuxError
from deux.search_path import leave_out_working_folder

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from deux.doctor.checkup import Checkup


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the checks and return the exit code: 0, or 1 if something that the options need is missing or wrong."""
    leave_out_working_folder()
    options = _parser().parse_intermixed_args(arguments)
    # Imported here because it imports torch, which `--help` must not wait for.
    from deux.doctor.checkup import Checkup

    checkup = Checkup(show=not options.json)
    try:
        _run(checkup, options.overrides, options.load)
    except DeuxError as error:  # the configuration cannot be composed, so it cannot be checked
        if options.json:
            checkup.fault(str(error))
        else:
            checkup.faults += 1
            print(f"deux: {error}", file=sys.stderr)
    if options.json:
        print(json.dumps(checkup.as_json(), indent=2))
    return 1 if checkup.faults else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m deux.doctor",
        description="Check the installation, the plugins, and the scenes and frames on disk for a command with these "
        "options. Include the output in bug reports. Exit code 1: something that the options need is missing or wrong.",
    )
    parser.add_argument(
        "overrides",
        nargs="*",
        metavar="option=value",
        help="options of python -m deux, such as scenes=mp3d scenes.root=FOLDER",
    )
    parser.add_argument("--load", action="store_true", help="load the first scene and describe it")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    return parser


def _run(checkup: Checkup, overrides: Sequence[str], load: bool) -> None:
    """Check the installation, then what the configuration needs.

    Raises:
        DeuxError: the configuration cannot be composed.
    """
    from deux.composition_errors import quoted_digits
    from deux.configuration import compose
    from deux.doctor.installation_checks import check_packages, check_simulators
    from deux.doctor.machine_checks import check_accelerator, check_folders, check_machine
    from deux.doctor.plugin_checks import check_chosen_plugins, check_models, check_plugins
    from deux.doctor.scene_checks import check_scenes

    check_machine(checkup)
    check_packages(checkup)
    check_plugins(checkup)
    check_models(checkup)
    cfg = compose([quoted_digits(override) for override in overrides])
    check_simulators(checkup, cfg)
    check_folders(checkup, cfg)
    check_chosen_plugins(checkup, cfg)
    check_accelerator(checkup, cfg)
    check_scenes(checkup, cfg, load)
    for option, folder in (("training_data", cfg.training_data), ("evaluation.data", cfg.evaluation.data)):
        if folder is not None:
            _check_frames(checkup, cfg, option, folder)


def _check_frames(checkup: Checkup, cfg: DictConfig, option: str, folder: str) -> None:
    """Check the recorded frames of an option; previews are written to `paths.outputs`/doctor/<option>."""
    from deux.configuration import user_path
    from deux.contracts import Reader
    from deux.doctor.frame_checks import check_frames
    from deux.geometry.camera import Camera
    from deux.options import construct
    from deux.registry import registry
    from deux.training.training_settings import TrainingSettings

    checkup.heading(f"Frames: {cfg.data.get('name')}, {option}={folder}")
    try:
        reader: Reader = registry().choose("readers", cfg.data).create(user_path(folder))
        checkup.fact("folder", str(reader.folder))
        training = construct(TrainingSettings, cfg.training, "training")
        camera = construct(Camera, cfg.camera, "camera")
        previews = user_path(cfg.paths.outputs) / "doctor" / option
        depth_range = camera.min_depth, camera.max_depth
        checks = check_frames(reader, training.offsets, previews, depth_range, checkup.line, training.sources)
        for check in checks:
            for problem in check.problems:
                checkup.count(problem)
        if not any(check.frames for check in checks):
            checkup.fault(f"{folder} has no frames in any split.")
        else:
            needed = "train" if option == "training_data" else "test"
            (check,) = (check for check in checks if check.split == needed)
            if not check.frames:
                checkup.fault(f"{option} needs {needed} frames: {check.facts[0]}")
    except DeuxError as error:
        checkup.fault(str(error))


if __name__ == "__main__":
    sys.exit(main())
