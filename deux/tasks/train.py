"""`task=train`: train the depth model on a dataset, collected or given."""

from pathlib import Path

from omegaconf import DictConfig

from deux.configuration import run_folder, user_path
from deux.errors import DeuxError
from deux.tasks.collect import collect
from deux.tasks.console import quieten_libraries, say
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings
from deux.tasks.training import train


def run(cfg: DictConfig) -> None:
    """Train on `training_data`, a folder in the layout of the VOID release, or on what the explorer collects."""
    quieten_libraries()
    settings = Settings(cfg)
    run = RunFolder(run_folder(), settings.identity)
    dataset = _given(cfg.training_data) if cfg.training_data else collect(settings, run)
    say(f"Train {settings.model.name} on {dataset}")
    with run.stage("train"):
        train(settings, settings.training, dataset, run)
    say(f"Trained. To evaluate it: python -m deux task=evaluate evaluation.checkpoint={run.path}")


def _given(path: str) -> Path:
    folder = user_path(path)
    if not (folder / "data").is_dir():
        raise DeuxError(
            f"training_data={path} is no dataset: it has no folder data/ with sequences in the VOID layout."
        )
    return folder
