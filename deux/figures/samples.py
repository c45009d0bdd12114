"""A model's output on a few frames, ready to be drawn."""

import torch
from lightning.fabric.utilities import move_data_to_device

from deux.contracts import Batch, DepthModel
from deux.figures.depth_panels import DepthSample
from deux.geometry.photometric_residual import photometric_residual
from deux.geometry.reprojection import reproject


@torch.no_grad()
def depth_samples(model: DepthModel, batch: Batch) -> list[DepthSample]:
    """Predict every frame of a batch that carries ground truth, and rebuild it from its source frames.

    Where the frames have no poses or no source frames, nothing can be rebuilt, and the residual is NaN.
    """
    batch = move_data_to_device(batch, next(model.parameters()).device)
    assert batch.ground_truth is not None
    predicted = model.predict(batch.image, batch.sparse_depth, batch.intrinsics)
    residual = torch.full_like(predicted[:, 0], torch.nan)
    if batch.source_from_target is not None:
        images, visible = reproject(batch.sources, predicted, batch.intrinsics, batch.source_from_target)
        residual = photometric_residual(batch.image, images, visible)
    return [
        DepthSample(
            rgb=(batch.image[i].permute(1, 2, 0) * 255.0).round().byte().cpu().numpy(),
            sparse_depth=batch.sparse_depth[i, 0].cpu().numpy(),
            predicted_depth=predicted[i, 0].cpu().numpy(),
            ground_truth=batch.ground_truth[i, 0].cpu().numpy(),
            residual=residual[i].cpu().numpy(),
        )
        for i in range(len(batch.image))
    ]
