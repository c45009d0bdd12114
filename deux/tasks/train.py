"""`task=train`: train the depth model on frames that are collected, or on recorded ones."""

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
from deux.tasks.recorded_frames import check_recorded, given_files, read_given, validation_of
from deux.tasks.run_folder import open_run_folder

_CHOICES = ("experiment", "scale", "model", "explore", "seed", "paths")
_OF_TEST_SCENES = (*_CHOICES, "scenes", "simulator", "camera", "robot", "sampling", "verification", "evaluation")
"""What makes the test frames of a command: views of its scenes, drawn by its seed, at its size. A preset may set any of
it, and may ask for a sweep over what the command has chosen."""

_OF_RECORDED_TRUTH = ("camera.min_depth", "camera.max_depth")
"""What the errors on recorded frames depend on beside these."""


def run(cfg: DictConfig) -> None:
    """Train on `training_data`, a folder of recorded frames, or on what the explorer collects.

    Recorded frames are validated on the validation split of their own folder, or not at all: generated flats are no
    judge of them. No scene is needed for them unless the robot explores while the model trains.
    """
    quieten_libraries()
    sections = sections_of(cfg)
    folder = converted(sections.plain("training_data"), str | None, "training_data")
    given = read_given(sections, folder) if folder else None
    explored = given is None or "active_collection" in sections.plain("callbacks")
    datasets = Datasets(sections, ["train"] if explored else None)
    evaluation = sections.read("evaluation", EvaluationSettings)
    training = Training(sections, datasets, evaluation.validation_viewpoints)
    exploration = GuidedCollection(sections, datasets, training) if given is None else None
    final = ActiveTraining(sections, datasets, training)
    weights = named_weights(sections, explorer=explored, guide=given is None)
    files = {} if given is None else given_files(given, "training_data", sections)
    with open_run_folder(run_folder(), sections.identity, weights, files) as run:
        data: Reader | None = given
        if exploration is not None:
            data = DatasetReader(exploration.collect(run))
        assert data is not None
        say(f"Train {training.recipe.model.name} on {data.folder}")
        validation = None if given is None else _recorded(given, training)
        with run.stage("train"):
            final.train(data, run, validation)
        frames = {} if given is None else _evaluation_frames(sections, given)
        kept = overrides_of(job_overrides(), _OF_TEST_SCENES if given is None else _OF_RECORDED_TRUTH)
        command = command_line({"task": "evaluate", **frames, "evaluation.checkpoint": run.path}, kept)
        say(f"Trained. To evaluate it: {command}")


def _evaluation_frames(sections: Sections, given: Reader) -> dict[str, Any]:
    """The options by which recorded frames are evaluated on, read as those that were trained on."""
    reader = sections.plugin("data")
    try:
        given.triplets("test", (-1,))
        folder = str(given.folder)
    except DeuxError:
        folder = "FOLDER_WITH_TEST_FRAMES"
    options = {f"data.{name}": value for name, value in reader.chosen.items()}
    return {"data": reader.name, **options, "evaluation.data": folder}


def _recorded(given: Reader, training: Training) -> list[Reader]:
    """Look at the recorded frames that are trained on; the readers of those to validate on."""
    model, settings = training.recipe.outline(), training.recipe.training
    offsets, choice = settings.offsets, settings.sources
    needs = training.recipe.needs()
    check_recorded(given, "train", offsets, model, needs, choice)
    validation = validation_of(given, offsets, needs, choice)
    for reader in validation:
        check_recorded(reader, "validation", offsets, model, needs._replace(ground_truth=True), choice)
    return validation
