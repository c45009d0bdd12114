"""`task=train`: train the depth model on collected or recorded frames."""

from typing import Any

from omegaconf import DictConfig

from deux.configuration import job_overrides, run_folder, sections_of
from deux.contracts import Reader
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.options import converted
from deux.task_sections import Sections
from deux.tasks.active_training import ActiveTraining
from deux.tasks.collect import GuidedCollection
from deux.tasks.command_lines import command_line, overrides_of
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import Datasets
from deux.tasks.evaluate import EvaluationSettings
from deux.tasks.model_training import Training
from deux.tasks.named_weights import named_weights
from deux.tasks.recorded_frames import check_recorded, data_digest, make_reader, validation_readers
from deux.tasks.run_folder import open_run_folder

_CHOICES = ("experiment", "scale", "model", "explore", "seed", "paths")
_OF_TEST_SCENES = (*_CHOICES, "scenes", "simulator", "camera", "robot", "sampling", "verification", "evaluation")
"""Options that determine the test frames, or that a preset may depend on; a command that evaluates repeats them."""

_OF_RECORDED_TRUTH = ("camera.min_depth", "camera.max_depth")
"""Options that the errors on recorded frames depend on."""


def run(cfg: DictConfig) -> None:
    """Train on `training_data`, a folder of recorded frames, or on what the explorer collects.

    Training on recorded frames is validated on the validation split of the same folder, or not at all, since generated
    flats would not be representative. It needs no scenes, unless the robot explores during training.
    """
    quieten_libraries()
    sections = sections_of(cfg)
    folder = converted(sections.plain("training_data"), str | None, "training_data")
    recorded = make_reader(sections, folder) if folder else None
    explores = recorded is None or "active_collection" in sections.plain("callbacks")
    datasets = Datasets(sections, ["train"] if explores else None)
    evaluation = sections.read("evaluation", EvaluationSettings)
    training = Training(sections, datasets, evaluation.validation_viewpoints)
    exploration = GuidedCollection(sections, datasets, training) if recorded is None else None
    final = ActiveTraining(sections, datasets, training)
    weights = named_weights(sections, explorer=explores, guide=recorded is None)
    files = {} if recorded is None else data_digest(recorded, "training_data", sections)
    with open_run_folder(run_folder(), sections.identity, weights, files) as run:
        data: Reader | None = recorded
        if exploration is not None:
            data = DatasetReader(exploration.collect(run))
        assert data is not None
        say(f"Train {training.recipe.model.name} on {data.folder}")
        validation = None if recorded is None else _check_and_split(recorded, training)
        with run.stage("train"):
            final.train(data, run, validation)
        frames = {} if recorded is None else _evaluation_options(sections, recorded)
        repeated = overrides_of(job_overrides(), _OF_TEST_SCENES if recorded is None else _OF_RECORDED_TRUTH)
        command = command_line({"task": "evaluate", **frames, "evaluation.checkpoint": run.path}, repeated)
        say(f"Trained. To evaluate it: {command}")


def _evaluation_options(sections: Sections, recorded: Reader) -> dict[str, Any]:
    """The options for an evaluation on recorded frames, with the reader of the training frames."""
    reader = sections.plugin("data")
    try:
        recorded.triplets("test", (-1,))
        folder = str(recorded.folder)
    except DeuxError:
        folder = "FOLDER_WITH_TEST_FRAMES"
    options = {f"data.{name}": value for name, value in reader.chosen.items()}
    return {"data": reader.name, **options, "evaluation.data": folder}


def _check_and_split(recorded: Reader, training: Training) -> list[Reader]:
    """Check the recorded training and validation frames; returns the readers of the validation frames."""
    model, settings = training.recipe.outline(), training.recipe.training
    offsets, choice = settings.offsets, settings.sources
    needs = training.recipe.needs()
    check_recorded(recorded, "train", offsets, model, needs, choice)
    validation = validation_readers(recorded, offsets, needs, choice)
    for reader in validation:
        check_recorded(reader, "validation", offsets, model, needs._replace(ground_truth=True), choice)
    return validation
