"""The training stage: a newly made model on one dataset."""

from pathlib import Path

from lightning import seed_everything

from deux.contracts import DepthModel
from deux.evaluation.drawing import save_figure
from deux.evaluation.metrics import DepthMetrics
from deux.evaluation.panel_logger import PanelLogger
from deux.evaluation.training_curve import draw_training_curve
from deux.tasks.console import say, training_bar
from deux.tasks.datasets import viewpoint_dataset
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings
from deux.training.fit import TrainingSettings, fit
from deux.training.model_files import MODEL_FILE, load_model, save_model


def train(settings: Settings, training: TrainingSettings, dataset: Path, run: RunFolder) -> DepthModel:
    """Train the configured model from scratch, or take it from the run folder if it is there already.

    Args:
        settings: the run's.
        training: budget and learning rate.
        dataset: frames to train on.
        run: takes `model.safetensors`, checkpoints, logs and the training curve.

    Returns:
        The trained model, in eval mode.
    """
    path = run.path / MODEL_FILE
    if path.exists():
        say(f"  trained before: {path}")
        return load_model(path)
    seed_everything(settings.seed, workers=True, verbose=False)
    model: DepthModel = settings.model.create()
    validation = [viewpoint_dataset(settings, "validation")] if settings.splits.validation else []
    fit(
        model,
        training,
        [dataset],
        validation,
        run.path,
        objective=settings.objective,
        pose=settings.run.pose,
        seed=settings.seed,
        metrics=DepthMetrics(settings.camera.min_depth, settings.camera.max_depth) if validation else None,
        trainer_arguments={"enable_progress_bar": bool(training_bar()), **settings.trainer},
        callbacks=[*training_bar(), *([PanelLogger()] if validation else [])],
    )
    model = model.cpu()
    save_figure(draw_training_curve(run.logs), run.figures / "training.png")
    save_model(path, model, settings.model.name, settings.model.settings)  # last: it says that training is done
    return model
