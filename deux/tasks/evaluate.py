"""`task=evaluate`: a trained model on the test scenes or on recorded data."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of, user_path
from deux.contracts import DepthModel, Reader
from deux.data.datamodule import TripletDataModule
from deux.data.dataset_reader import DatasetReader
from deux.data.triplets import TripletDataset, collate
from deux.errors import check_range
from deux.figures.depth_figures import depth_samples, draw_depth_panels
from deux.figures.drawing import save_figure
from deux.geometry.camera import Camera
from deux.inference.precision import default_device
from deux.metrics.model_errors import Evaluation, evaluate
from deux.report.results import RESULTS_FILE, Results
from deux.task_sections import Sections
from deux.tasks.checkpoints import find_trained_run, load_needed_model, provenance
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.datasets import Datasets
from deux.tasks.run_folder import RunFolder, open_run_folder
from deux.training.fit import TrainingSettings

PANEL_ROWS = 4
"""Test frames that the figure shows."""


@dataclass(frozen=True)
class EvaluationSettings:
    """On what models are evaluated.

    Args:
        viewpoints: test frames of each scene.
        validation_viewpoints: validation frames of each scene.
        checkpoint: the model of `task=evaluate`.
        data: a folder of recorded frames to evaluate on in place of the test scenes.

    Raises:
        DeuxError: a value is out of its range.
    """

    viewpoints: int
    validation_viewpoints: int
    checkpoint: str | None
    data: str | None

    def __post_init__(self) -> None:
        check_range("evaluation.viewpoints", self.viewpoints, 1)
        check_range("evaluation.validation_viewpoints", self.validation_viewpoints, 1)


class Evaluator:
    """Measures a model's errors on test frames, and draws some of them.

    Args:
        sections: of these it reads `camera`, `training` (the crop) and `trainer` (the device).

    Raises:
        DeuxError: an option is wrong.
    """

    def __init__(self, sections: Sections) -> None:
        self._camera = sections.read("camera", Camera)
        self._crop = sections.read("training", TrainingSettings).crop
        self._device = default_device(sections.plain("trainer").get("accelerator", "auto"))

    def evaluate(self, model: DepthModel, data: Reader, run: RunFolder) -> Evaluation:
        """The errors of a model, which is moved to the trainer's kind of device, on the test split of some frames."""
        model.to(self._device)
        loader = TripletDataModule(model, test=[data], batch_size=4, crop=self._crop).test_dataloader()
        frames: TripletDataset = loader.dataset  # type: ignore[assignment]
        done = 0
        with progress() as report:

            def count(images: int) -> None:
                nonlocal done
                done += images
                report("evaluation", done, len(frames))

            found = evaluate(model, loader, self._camera.min_depth, self._camera.max_depth, count)
        spread = range(0, len(frames), max(1, len(frames) // PANEL_ROWS))[:PANEL_ROWS]
        samples = [sample for i in spread for sample in depth_samples(model, collate([frames[i]]))]
        save_figure(draw_depth_panels(samples), run.figures / "test_frames.png")
        return found


def run(cfg: DictConfig) -> None:
    """Evaluate `evaluation.checkpoint` on the test viewpoints, or on `evaluation.data`.

    What the same model was measured to reach on the same viewpoints before is not measured again.
    """
    quieten_libraries()
    sections = sections_of(cfg)
    settings = sections.read("evaluation", EvaluationSettings)
    stage = Evaluator(sections)
    given = read_given(sections, settings.data) if settings.data else None
    datasets = None if given else Datasets(sections, ["test"])
    checkpoint = settings.checkpoint and find_trained_run(sections, settings.checkpoint)
    name, model = load_needed_model(sections.plugin("model"), checkpoint, "evaluation.checkpoint")
    trained = provenance(str(checkpoint))
    with open_run_folder(run_folder(), sections.identity) as run:
        if given is None and _finished(run.path, trained):
            say(f"This run is complete: {run.path}")
            say(Results.load(run.path).table())
            return
        say(f"Evaluate {checkpoint}")
        with run.stage("evaluate"):
            if datasets is not None:
                given = DatasetReader(datasets.viewpoints("test", settings.viewpoints))
            assert given is not None
            found = stage.evaluate(model, given, run)
        results = Results(
            model=name,
            explore=None,
            seed=sections.seed,
            frames=None,
            metrics=found.metrics,
            baseline=found.baseline,
            constant=found.constant,
            seconds=run.seconds,
            trained=trained,
        )
        results.save(run.path)
        say(results.table())


def read_given(sections: Sections, folder: str) -> Reader:
    """The reader of a folder of recorded frames, as the section `data` says it is read."""
    reader: Reader = sections.plugin("data").create(user_path(folder))
    return reader


def _finished(folder: Path, trained: dict[str, Any]) -> bool:
    if not (folder / RESULTS_FILE).exists():
        return False
    known = Results.load(folder).trained
    return known is not None and known.get("weights") == trained["weights"]
