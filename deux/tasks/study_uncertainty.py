"""`task=study_uncertainty`: how well uncertainty measures predict a depth model's errors in unseen scenes."""

from collections.abc import Sequence

from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of
from deux.errors import counted
from deux.figures.drawing import save_figure
from deux.io.atomic import write_atomically, write_json
from deux.report.results import RESULTS_FILE
from deux.studies.evaluated_walk import EvaluatedSample
from deux.studies.uncertainty_episodes import installed_measures, study_uncertainty
from deux.studies.uncertainty_figures import draw_frames, draw_sparsification, draw_uncertainty_maps
from deux.studies.uncertainty_study import UncertaintyStudy
from deux.studies.uncertainty_tables import agreement_table, causes_table
from deux.task_sections import Sections
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.datasets import Datasets, check_robot
from deux.tasks.evaluate import EvaluationSettings
from deux.tasks.model_training import Training
from deux.tasks.named_weights import named_weights
from deux.tasks.run_folder import EPISODES, RunFolder, open_run_folder
from deux.tasks.seed_model import SeedModel, TrainedModel


def run(cfg: DictConfig) -> None:
    """Evaluate the seed model's depth and uncertainty along the explorer's path through the test scenes.

    Scenes that an earlier attempt in the same folder finished are not repeated.
    """
    quieten_libraries()
    stages = StudyStages(sections_of(cfg))
    evaluated = stages.seed_model.get()  # before opening the folder, since its weights are part of the run's identity
    identity = stages.identity | {"seed model": evaluated.weights}
    with open_run_folder(run_folder(), identity, stages.weights) as run:
        say(f"Run folder: {run.path}")
        study = stages.evaluate(evaluated, run)
        stages.draw(study, run)
        stages.write(study, evaluated, run)
        say(f"Tables, figures and the values of every frame: {run.path}")


class StudyStages:
    """The stages of a study of uncertainty measures.

    Args:
        sections: configuration.

    Raises:
        DeuxError: an option is wrong, or there is no test scene.
    """

    def __init__(self, sections: Sections) -> None:
        self._task = sections.task
        self._datasets = Datasets(sections, ["test"])
        evaluation = sections.read("evaluation", EvaluationSettings)
        self._training = Training(sections, self._datasets, evaluation.validation_viewpoints)
        self._explorer = sections.plugin("explore")
        check_robot(self._explorer, "task=study_uncertainty")
        self._datasets.collect.measure.create()  # checks its options before a model is trained
        self.seed_model = SeedModel(sections, self._datasets, self._training)
        self.identity = sections.identity
        self.weights = named_weights(sections, guide=False, trained=False)

    def evaluate(self, evaluated: TrainedModel, run: RunFolder) -> UncertaintyStudy:
        """Run the explorer in the test scenes, and compute all installed measures for every frame."""
        measures, left_out = installed_measures()
        for name, reason in left_out.items():
            say(f"Without {name}: {reason}")
        datasets = self._datasets
        say(f"Walk through {counted(len(datasets.scenes.test), 'test scene')} with {self._explorer.name}")

        def show(samples: Sequence[EvaluatedSample]) -> None:
            save_figure(draw_uncertainty_maps(samples), run.figures / "maps.png")

        with run.stage("evaluate"), progress() as report:
            return study_uncertainty(
                run.path / EPISODES,
                datasets.simulation,
                datasets.scenes.test,
                self._explorer,
                self._training.predictor(evaluated.model),
                datasets.sampling,
                measures,
                self._training.seed,
                datasets.collect.steps,
                datasets.collect.measure,
                show,
                report,
                datasets.collect.correct_depth,
                datasets.collect.remembered_frames,
            )

    def draw(self, study: UncertaintyStudy, run: RunFolder) -> None:
        """Draw the figures of the study."""
        with run.stage("draw"):
            save_figure(draw_sparsification(study), run.figures / "sparsification.png")
            save_figure(draw_frames(study), run.figures / "frames.png")

    def write(self, study: UncertaintyStudy, evaluated: TrainedModel, run: RunFolder) -> None:
        """Write the tables and, last, `results.json`; print the tables."""
        tables = [agreement_table(study), causes_table(study)]
        if study.count("moved"):
            tables.insert(1, agreement_table(study, "moved"))
        page = [f"# Uncertainty of {evaluated.name}: {counted(len(study.scenes), 'scene')}, {self._explorer.name}", ""]
        page += [table.markdown() for table in tables]
        write_atomically(run.path / "table.md", "\n".join(page).encode())
        write_atomically(run.path / "frames.csv", study.frames_csv().encode())
        write_json(
            run.path / RESULTS_FILE,
            {
                "task": self._task,
                "model": evaluated.name,
                "explore": self._explorer.name,
                "seed": self._training.seed,
                "scenes": list(study.scenes),
                "frames": study.count(),
                "measures": study.summary(),
                "seconds": run.seconds,
            },
        )
        for table in tables:
            say(table)
