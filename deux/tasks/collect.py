"""`task=collect`: explore the training scenes and write the dataset."""

from pathlib import Path

from omegaconf import DictConfig

from deux.configuration import run_folder
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import explored_dataset
from deux.tasks.evaluation import draw_trajectories
from deux.tasks.run_folder import RunFolder
from deux.tasks.seed_model import needs_model, seed_model
from deux.tasks.settings import Settings
from deux.tasks.training import Trainee, chosen_trainee
from deux.training.ranks import leads


def run(cfg: DictConfig) -> None:
    """Collect the configured explorer's dataset and draw its trajectories."""
    quieten_libraries()
    settings = Settings(cfg)
    run = RunFolder(run_folder(), settings.identity)
    dataset = collect(settings, run, chosen_trainee(settings))
    if not leads():
        return
    draw_trajectories(settings, dataset, settings.explorer.name, run.figures)
    say(f"Dataset: {dataset}")


def collect(settings: Settings, run: RunFolder, trainee: Trainee) -> Path:
    """The configured explorer's dataset; with a seed model first, of the trainee's kind, if the explorer needs one."""
    model, identity = None, None
    if needs_model(settings.explorer):
        say(f"Seed model: {settings.model.name} on the {settings.seed_explorer.name} frames")
        with run.stage("seed"):
            model, identity = seed_model(settings, trainee)
    say(f"Explore with {settings.explorer.name}")
    with run.stage("collect"):
        return explored_dataset(settings, settings.explorer, model, identity)
