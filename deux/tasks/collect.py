"""`task=collect`: explore the training scenes and write the dataset."""

import logging
from pathlib import Path

from omegaconf import DictConfig

from deux.collection.explored_map import episode_poses, explored_map
from deux.collection.perception import needs_model
from deux.collection.replay import ReplayDiverged
from deux.configuration import run_folder, sections_of
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError, image_size
from deux.inference.precision import FastPredictor
from deux.io.layout import sequences
from deux.metrics.scorecard import score
from deux.task_sections import Sections
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import Datasets, is_ceiling
from deux.tasks.evaluate import EvaluationSettings
from deux.tasks.model_training import Training
from deux.tasks.named_weights import named_weights
from deux.tasks.run_folder import RunFolder, open_run_folder
from deux.tasks.seed_model import SeedModel
from deux.training.ranks import leads

MOST_TRAJECTORIES = 6
"""Number of episodes whose trajectories are drawn, and recorded for a viewer."""

log = logging.getLogger(__name__)


def run(cfg: DictConfig) -> None:
    """Collect the dataset of the configured explorer, draw the trajectories and write a scorecard of the frames."""
    quieten_libraries()
    sections = sections_of(cfg)
    datasets = Datasets(sections, ["train"])
    if datasets.collect.viewer:
        from deux.figures.viewer_recording import check_viewer  # imports matplotlib, which is slow

        check_viewer("collect.viewer")
    evaluation = sections.read("evaluation", EvaluationSettings)
    training = Training(sections, datasets, evaluation.validation_viewpoints)
    exploration = GuidedCollection(sections, datasets, training)
    with open_run_folder(run_folder(), sections.identity, named_weights(sections, trained=False)) as run:
        dataset = exploration.collect(run)
        if leads():
            exploration.draw(dataset, run)
            choice = training.recipe.source_choice()
            card = score(DatasetReader(dataset), choice=choice, simulation=datasets.simulation)
            card.save(run.path)
            exploration.record(dataset, run)
            say(card.table(f"Scorecard of the {exploration.explorer.name} frames"))
            say(f"Dataset: {dataset}")


class GuidedCollection:
    """Collects the frames of the configured explorer, guided by a seed model if it needs one.

    Args:
        sections: configuration; reads `explore` and, if the explorer needs a model, `seed_model`.
        datasets: datasets of the run.
        training: trains the seed model.

    Raises:
        DeuxError: an option is wrong.
    """

    def __init__(self, sections: Sections, datasets: Datasets, training: Training) -> None:
        self.explorer = sections.plugin("explore")
        self.guided = needs_model(self.explorer)
        self._datasets = datasets
        self._training = training
        camera, crop = datasets.simulation.camera, training.recipe.training.crop
        if crop is not None and (crop[0] > camera.height or crop[1] > camera.width):
            raise DeuxError(
                f"training.crop=[{crop[0]},{crop[1]}] is {image_size(crop)} pixels (width x height), larger than the "
                f"camera's {camera.width} x {camera.height}: give [height,width] within the camera's."
            )
        self._seed_model = None
        self._predictor: FastPredictor | None = None
        if self.guided:
            datasets.collect.measure.create()  # checks its options before the seed model is trained
            self._seed_model = SeedModel(sections, datasets, training)

    def collect(self, run: RunFolder) -> Path:
        """Collect the dataset, after training the seed model if the explorer needs one; returns its folder."""
        identity = None
        if self._seed_model is not None:
            with run.stage("seed"):
                guide = self._seed_model.get()
            self._predictor = self._training.predictor(guide.model)
            identity = f"{guide.weights} in {self._predictor.precision}"
        say(f"Explore with {self.explorer.name}")
        with run.stage("collect"):
            return self._datasets.explored(self.explorer, self._predictor, identity)

    def draw(self, dataset: Path, run: RunFolder) -> None:
        """Draw the trajectories of the first episodes; there are none for free viewpoints."""
        if is_ceiling(self.explorer):
            return
        from deux.figures.drawing import save_figure  # imports matplotlib, which is slow
        from deux.figures.trajectory import draw_trajectory

        simulation = self._datasets.simulation
        for sequence in sequences(dataset)[:MOST_TRAJECTORIES]:
            explored = explored_map(sequence, simulation.camera, simulation.robot)
            title = f"{self.explorer.name} in {sequence.name}"
            figure = draw_trajectory(explored, episode_poses(sequence), title)
            save_figure(figure, run.figures / f"trajectory_{sequence.name}.png")

    def record(self, dataset: Path, run: RunFolder) -> None:
        """Write recordings of the first episodes if `collect.viewer` is set; call it after `collect`.

        If the replay of an episode diverges, its recording ends there.
        """
        if self._datasets.collect.viewer is None or is_ceiling(self.explorer):
            return
        from deux.figures.exploration_recording import ExplorationRecording  # imports matplotlib, which is slow

        for sequence in sequences(dataset)[:MOST_TRAJECTORIES]:
            path = run.path / "recordings" / f"{sequence.name}.rrd"
            with ExplorationRecording(path, sequence.name) as recording:
                try:
                    for step in self._datasets.replayed(sequence, self.explorer, self._predictor):
                        recording.add(step)
                except ReplayDiverged as error:
                    log.warning("%s", error)
            say(f"Recording: {path}")
