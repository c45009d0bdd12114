"""`task=experiment`: train the seed model, explore with it, train the final model and evaluate it."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from omegaconf import DictConfig

from deux.collection.pipeline import frame_count
from deux.configuration import run_folder, sections_of
from deux.contracts import DepthModel
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.metrics.scorecard import score
from deux.report.results import RESULTS_FILE, Results
from deux.task_sections import Sections
from deux.tasks.active_training import ActiveTraining, read_rounds
from deux.tasks.collect import GuidedCollection
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import Datasets
from deux.tasks.evaluate import EvaluationSettings, Evaluator
from deux.tasks.model_training import Training
from deux.tasks.named_weights import named_weights
from deux.tasks.run_folder import RunFolder, open_run_folder
from deux.training.ranks import decided_by_leader, leads

if TYPE_CHECKING:
    from deux.metrics.model_errors import Evaluation


def run(cfg: DictConfig) -> None:
    """Run the whole experiment, or resume it where an earlier attempt in the same folder stopped."""
    quieten_libraries()
    experiment = Experiment(sections_of(cfg))
    with open_run_folder(run_folder(), experiment.identity, experiment.weights) as run:
        if not experiment.is_finished(run):
            frames = experiment.explore(run)
            model = experiment.train(frames, run)
            if leads():
                errors = experiment.evaluate(model, frames, run)
                experiment.write(frames, errors, run)
        experiment.show(run)


class Experiment:
    """The stages of the paper's experiment.

    Args:
        sections: configuration.

    Raises:
        DeuxError: an option is wrong.
    """

    def __init__(self, sections: Sections) -> None:
        self.identity = sections.identity
        self._evaluation = sections.read("evaluation", EvaluationSettings)
        for name in ("data", "checkpoint"):
            if value := getattr(self._evaluation, name):
                raise DeuxError(
                    f"evaluation.{name}={value} has no effect with task=experiment, which evaluates its own model on "
                    "the test scenes: use task=evaluate."
                )
        self._datasets = Datasets(sections, ["train", "test"])
        self._training = Training(sections, self._datasets, self._evaluation.validation_viewpoints)
        self._exploration = GuidedCollection(sections, self._datasets, self._training)
        self._final = ActiveTraining(sections, self._datasets, self._training)
        self._evaluator = Evaluator(sections)
        self.weights = named_weights(sections)

    def is_finished(self, run: RunFolder) -> bool:
        """Whether an earlier attempt has finished; also prints the run folder."""
        finished = decided_by_leader((run.path / RESULTS_FILE).exists)
        say(f"{'This run is complete' if finished else 'Run folder'}: {run.path}")
        return finished

    def explore(self, run: RunFolder) -> Path:
        """Collect the final model's frames, guided by the seed model if the explorer needs one (Alg. 1)."""
        return self._exploration.collect(run)

    def train(self, frames: Path, run: RunFolder) -> DepthModel:
        """Train the final model from scratch on the explored frames only (Eq. 7)."""
        say(f"Train {self._training.recipe.model.name} on the {self._exploration.explorer.name} frames")
        with run.stage("train"):
            return self._final.train(DatasetReader(frames), run)

    def evaluate(self, model: DepthModel, frames: Path, run: RunFolder) -> "Evaluation":
        """Compute the model's errors on free viewpoints of the test scenes; also write the frames' scorecard."""
        say("Evaluate on free viewpoints of the test scenes")
        with run.stage("evaluate"):
            viewpoints = self._datasets.viewpoints("test", self._evaluation.viewpoints)
            evaluation = self._evaluator.evaluate(model, DatasetReader(viewpoints), run)
        card = score(
            DatasetReader(frames),
            choice=self._training.recipe.source_choice(),
            tests=DatasetReader(viewpoints),
            simulation=self._datasets.simulation,
        )
        card.save(run.path)
        return evaluation

    def write(self, frames: Path, evaluation: "Evaluation", run: RunFolder) -> None:
        """Draw the trajectories and write `results.json`, which marks the run as finished."""
        self._exploration.draw(frames, run)
        rounds = read_rounds(run)
        results = Results(
            model=self._training.recipe.model.name,
            explore=self._exploration.explorer.name,
            seed=self._training.seed,
            frames=frame_count(frames, self._training.recipe.source_choice()) + sum(each.frames for each in rounds),
            seconds=run.seconds,
            rounds=[each.summary() for each in rounds],
            **asdict(evaluation),
        )
        results.save(run.path)

    def show(self, run: RunFolder) -> None:
        """Print the table of errors."""
        if leads():
            say(Results.load(run.path).table())
            say(f"Figures and logs: {run.path}")
