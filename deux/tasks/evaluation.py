"""The evaluation stage: errors on the test frames, and the pictures that go with them."""

from pathlib import Path

from deux.contracts import DepthModel
from deux.data.datamodule import TripletDataModule
from deux.data.layout import sequences
from deux.evaluation.depth_panels import draw_depth_panels
from deux.evaluation.drawing import save_figure
from deux.evaluation.evaluate import Evaluation, evaluate
from deux.evaluation.explored import episode_poses, explored_map
from deux.evaluation.samples import depth_samples
from deux.evaluation.trajectory import draw_trajectory
from deux.tasks.console import progress
from deux.tasks.settings import Settings

PANEL_ROWS = 4
"""Test frames that the figure shows."""

MOST_TRAJECTORIES = 6
"""Episodes of which the trajectory is drawn."""


def evaluate_model(settings: Settings, model: DepthModel, dataset: Path, figures: Path) -> Evaluation:
    """Evaluate a model on a dataset's test split, and draw some of its frames."""
    data = TripletDataModule(model, test=[dataset], batch_size=4, crop=settings.training.crop)
    loader = data.test_dataloader()
    total = len(loader.dataset)  # type: ignore[arg-type]
    done = 0
    with progress() as report:

        def count(frames: int) -> None:
            nonlocal done
            done += frames
            report("evaluation", done, total)

        result = evaluate(model, loader, settings.camera.min_depth, settings.camera.max_depth, count)
    samples = [sample for batch in loader for sample in depth_samples(model, batch)]
    spread = samples[:: max(1, len(samples) // PANEL_ROWS)][:PANEL_ROWS]
    save_figure(draw_depth_panels(spread), figures / "test_frames.png")
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
