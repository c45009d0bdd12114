"""Files that record a command in its run folder: the run's configuration and the command's overrides."""

from pathlib import Path

IDENTITY_FILE = "run.json"
"""File of a run's whole configuration, in its folder."""

RECORD_FOLDER = ".hydra"
"""Subfolder of the run folder with the composed configuration and the command's overrides."""


def record_folder(output_dir: str) -> str | None:
    """The folder in which Hydra records the command; None, for no record, if a run has already started in `output_dir`.

    Hydra writes its record before the task starts, and the task may refuse the folder as that of another run, whose
    record must remain. A task that reuses such a folder writes the record itself (`deux.tasks.run_folder`).
    """
    return None if Path(output_dir, IDENTITY_FILE).exists() else RECORD_FOLDER
