"""`task=evaluate`: evaluate a trained model on the test scenes or on recorded frames."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of
from deux.contracts import DepthModel, Reader
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError, check_range
from deux.geometry.camera import Camera
from deux.inference.precision import default_device
from deux.report.results import RESULTS_FILE, Results
from deux.task_sections import Sections
from deux.tasks.checkpoints import find_trained_run, load_required_model, pretrained_identity, provenance
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.datasets import Datasets
from deux.tasks.recorded_frames import Needs, check_recorded, make_reader
from deux.tasks.run_folder import RunFolder, open_run_folder
from deux.training.training_settings import TrainingSettings

if TYPE_CHECKING:
    from deux.data.triplets import TripletDataset
    from deux.figures.depth_figures import DepthSample
    from deux.metrics.model_errors import Evaluation

PANEL_ROWS = 4
"""Number of test frames in the figure."""


@dataclass(frozen=True)
class EvaluationSettings:
    """Options of the evaluation of models.

    Args:
        viewpoints: test frames per scene.
        validation_viewpoints: validation frames per scene.
        checkpoint: the model of `task=evaluate`.
        data: a folder of recorded frames to evaluate on instead of the test scenes.

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
    """Computes a model's errors on test frames, and draws some of the frames.

    Args:
        sections: configuration; reads `camera`, `training` (crop and source frames) and `trainer` (device).

    Raises:
        DeuxError: an option is wrong.
    """

    def __init__(self, sections: Sections) -> None:
        self._camera = sections.read("camera", Camera)
        training = sections.read("training", TrainingSettings)
        self._crop, self.offsets = training.crop, training.offsets
        self._device = default_device(sections.plain("trainer").get("accelerator", "auto"))

    def evaluate(self, model: DepthModel, data: Reader, run: RunFolder) -> "Evaluation":
        """Compute a model's errors on the test split of `data`; the model is moved to the trainer's device."""
        # Slow imports: torchmetrics, Lightning and matplotlib.
        from deux.data.datamodule import TripletDataModule
        from deux.figures.depth_figures import draw_depth_panels
        from deux.figures.drawing import save_figure
        from deux.metrics.model_errors import evaluate

        model.to(self._device)
        # Without a crop, recorded frames may differ in size and then cannot be batched.
        batch_size = 1 if self._crop is None else 4
        module = TripletDataModule(model, test=[data], batch_size=batch_size, crop=self._crop, offsets=self.offsets)
        loader = module.test_dataloader()
        frames: TripletDataset = loader.dataset  # type: ignore[assignment]
        done = 0
        with progress() as report:

            def count(images: int) -> None:
                nonlocal done
                done += images
                report("evaluation", done, len(frames))

            near, far = self._camera.min_depth, self._camera.max_depth
            scenes = [reader.place(triplet.target) for reader, triplet in frames.triplets]
            evaluation = evaluate(model, loader, near, far, count, scenes)
        save_figure(draw_depth_panels(self._panels(model, frames)), run.figures / "test_frames.png")
        return evaluation

    def _panels(self, model: DepthModel, frames: "TripletDataset") -> "list[DepthSample]":
        """Some test frames with predictions, and with residuals if they have source frames with poses."""
        from deux.data.triplets import collate
        from deux.figures.depth_figures import depth_samples

        samples = []
        for index in range(0, len(frames), max(1, len(frames) // PANEL_ROWS))[:PANEL_ROWS]:
            try:
                frame = frames.with_sources(index)
            except DeuxError:  # a source frame is damaged, which the evaluation does not need
                frame = frames[index]
            samples += depth_samples(model, collate([frame]))
        return samples


def run(cfg: DictConfig) -> None:
    """Evaluate `evaluation.checkpoint` on the test viewpoints, or on `evaluation.data`.

    An evaluation of the same model on the same viewpoints is not repeated.
    """
    quieten_libraries()
    sections = sections_of(cfg)
    settings = sections.read("evaluation", EvaluationSettings)
    evaluator = Evaluator(sections)
    recorded = make_reader(sections, settings.data) if settings.data else None
    datasets = None if recorded else Datasets(sections, ["test"])
    checkpoint = settings.checkpoint and find_trained_run(sections, settings.checkpoint)
    name, model = load_required_model(sections.plugin("model"), checkpoint, "evaluation.checkpoint")
    if checkpoint:
        trained = provenance(checkpoint)
    else:
        trained = {"weights": pretrained_identity(sections.plugin("model"), model), "settings": None}
    with open_run_folder(run_folder(), sections.identity) as run:
        if recorded is None and _is_finished(run.path, trained):
            say(f"This run is complete: {run.path}")
            say(Results.load(run.path).table())
            return
        say(f"Evaluate {checkpoint or name}")
        with run.stage("evaluate"):
            if recorded is not None:
                check_recorded(recorded, "test", evaluator.offsets, model, Needs(ground_truth=True))
                data = recorded
            else:
                assert datasets is not None
                data = DatasetReader(datasets.viewpoints("test", settings.viewpoints))
            evaluation = evaluator.evaluate(model, data, run)
        results = Results(
            model=name,
            explore=None,
            seed=sections.seed,
            frames=None,
            seconds=run.seconds,
            trained=trained,
            **asdict(evaluation),
        )
        results.save(run.path)
        say(results.table())


def _is_finished(folder: Path, trained: dict[str, Any]) -> bool:
    if not (folder / RESULTS_FILE).exists():
        return False
    evaluated = Results.load(folder).trained
    return evaluated is not None and evaluated.get("weights") == trained["weights"]
