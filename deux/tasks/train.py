"""`task=train`: train the depth model on a dataset, collected or given."""

from omegaconf import DictConfig

from deux.configuration import run_folder
from deux.tasks.collect import collect
from deux.tasks.console import quieten_libraries, say
from deux.tasks.given import given_dataset
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings
from deux.tasks.training import chosen_trainee, train


def run(cfg: DictConfig) -> None:
    """Train on `training_data`, a folder in the layout of the VOID release, or on what the explorer collects."""
    quieten_libraries()
    settings = Settings(cfg)
    given = settings.run.training_data
    dataset = given_dataset("training_data", given) if given else None
    run = RunFolder(run_folder(), settings.identity)
    trainee = chosen_trainee(settings)
    dataset = dataset or collect(settings, run, trainee)
    say(f"Train {settings.model.name} on {dataset}")
    with run.stage("train"):
        train(settings, trainee, settings.training, dataset, run, settings.active)
    say(f"Trained. To evaluate it: python -m deux task=evaluate evaluation.checkpoint={run.path}")
