"""What a command leaves in its run folder to tell which run that is: its own overrides, and all that the run is."""

from pathlib import Path

IDENTITY_FILE = "run.json"
"""The whole configuration of a run, in its folder from its beginning on."""

RECORD_FOLDER = ".hydra"
"""The folder, in a run's own, of what Hydra composed and of the command's overrides."""


def record_folder(output_dir: str) -> str | None:
    """Where Hydra writes what a command was; nowhere in a folder that a run has begun in.

    Hydra writes it before a task begins, and the task may refuse the folder as another command's, whose record is to
    stay. A task that takes such a folder over writes its own (`deux.tasks.run_folder`).
    """
    return None if Path(output_dir, IDENTITY_FILE).exists() else RECORD_FOLDER
