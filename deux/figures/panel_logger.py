"""Pictures of the model at work in TensorBoard, while it trains."""

from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.loggers import TensorBoardLogger

from deux.contracts import Batch
from deux.figures.depth_panels import draw_depth_panels
from deux.figures.samples import depth_samples
from deux.training.module import DepthCompletion


class PanelLogger(Callback):
    """Draws the first frames of each validation into the TensorBoard log.

    Args:
        frames: number of frames, at most one batch of them.
    """

    def __init__(self, frames: int = 3) -> None:
        self.frames = frames

    def on_validation_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Batch,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Draw the first batch."""
        if batch_idx > 0 or batch.ground_truth is None or not isinstance(pl_module, DepthCompletion):
            return
        figure = draw_depth_panels(depth_samples(pl_module.model, batch)[: self.frames])
        for logger in trainer.loggers:
            if isinstance(logger, TensorBoardLogger):
                logger.experiment.add_figure("validation/frames", figure, trainer.global_step)
