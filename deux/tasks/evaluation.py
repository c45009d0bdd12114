"""The evaluation stage: errors on the test frames, and the pictures that go with them."""

from pathlib import Path

from deux.collection.explored_map import episode_poses, explored_map
from deux.contracts import DepthModel
from deux.data.datamodule import TripletDataModule
from deux.data.triplets import TripletDataset, collate
from deux.figures.depth_panels import draw_depth_panels
from deux.figures.drawing import save_figure
from deux.figures.samples import depth_samples
from deux.figures.trajectory import draw_trajectory
from deux.inference.precision import default_device
from deux.io.layout import sequences
from deux.metrics.model_errors import Evaluation, evaluate
from deux.tasks.console import progress
from deux.tasks.settings import Settings

PANEL_ROWS = 4
"""Test frames that the figure shows."""

MOST_TRAJECTORIES = 6
"""Episodes of which the trajectory is drawn."""


def evaluate_model(settings: Settings, model: DepthModel, dataset: Path, figures: Path) -> Evaluation:
    """Evaluate a model on a dataset's test split, on the trainer's kind of device, and draw some of its frames."""
    model.to(default_device(settings.trainer.get("accelerator", "auto")))
    data = TripletDataModule(model, test=[dataset], batch_size=4, crop=settings.training.crop)
    loader = data.test_dataloader()
    frames: TripletDataset = loader.dataset  # type: ignore[assignment]
    total = len(frames)
    done = 0
    with progress() as report:

        def count(images: int) -> None:
            nonlocal done
            done += images
            report("evaluation", done, total)

        result = evaluate(model, loader, settings.camera.min_depth, settings.camera.max_depth, count)
    spread = range(0, total, max(1, total // PANEL_ROWS))[:PANEL_ROWS]
    samples = [sample for i in spread for sample in depth_samples(model, collate([frames[i]]))]
    save_figure(draw_depth_panels(samples), figures / "test_frames.png")
    return result


def draw_trajectories(settings: Settings, dataset: Path, explorer: str, figures: Path) -> None:
    """Draw where the robot went in each training scene."""
    for sequence in sequences(dataset)[:MOST_TRAJECTORIES]:
        explored = explored_map(sequence, settings.camera, settings.robot)
        title = f"{explorer} in {sequence.name}"
        save_figure(
            draw_trajectory(explored, episode_poses(sequence), title),
            figures / f"trajectory_{sequence.name}.png",
        )
