"""`task=train`: train the depth model on frames that are collected, or on recorded ones."""

from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of
from deux.contracts import Reader
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.task_sections import Sections
from deux.tasks.active_training import ActiveTraining
from deux.tasks.collect import Exploration
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import Datasets
from deux.tasks.evaluate import EvaluationSettings, read_given
from deux.tasks.model_training import Training
from deux.tasks.run_folder import open_run_folder


def run(cfg: DictConfig) -> None:
    """Train on `training_data`, a folder of recorded frames, or on what the explorer collects."""
    quieten_libraries()
    sections = sections_of(cfg)
    folder = sections.plain("training_data")
    given = read_given(sections, folder) if folder else None
    explored = given is None or "active_collection" in sections.plain("callbacks")
    datasets = Datasets(sections, ["train"] if explored else [])
    evaluation = sections.read("evaluation", EvaluationSettings)
    training = Training(sections, datasets, evaluation.validation_viewpoints)
    exploration = Exploration(sections, datasets, training) if given is None else None
    final = ActiveTraining(sections, datasets, training)
    with open_run_folder(run_folder(), sections.identity) as run:
        data: Reader | None = given
        if exploration is not None:
            data = DatasetReader(exploration.collect(run))
        assert data is not None
        say(f"Train {training.recipe.model.name} on {data.folder}")
        with run.stage("train"):
            final.train(data, run, _recorded_validation(given, sections) if given else None)
        say(f"Trained. To evaluate it: python -m deux task=evaluate evaluation.checkpoint={run.path}")


def _recorded_validation(given: Reader, sections: Sections) -> list[Reader]:
    """Recorded frames are no judge of others: validation is on the folder's own validation split, if it has one."""
    offsets = tuple(sections.plain("training").get("offsets", (-1, -2)))
    try:
        given.triplets("validation", offsets)
    except DeuxError:
        return []
    return [given]
