"""Batches of rendered samples, equivalent to those of the collector and the data loader."""

from dataclasses import replace

import numpy as np
import torch

from deux.bench.bench_scenes import default_simulation, flats
from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import Action, Batch, DepthModel, Frame
from deux.data.triplets import collate
from deux.geometry.camera import Camera
from deux.geometry.poses import source_from_target
from deux.simulator.starts import random_starts


def render_batch(model: DepthModel, size: int, count: int) -> Batch:
    """Render a batch of samples at random places of a generated flat.

    The robot moves forward and then turns left between the three frames of a sample.

    Args:
        model: depth model that prepares its further inputs.
        size: height and width of the images in pixels.
        count: number of samples.
    """
    simulator = default_simulation(size).make(flats(1)[0])
    samples = []
    for start in random_starts(simulator.free_space(), count, np.random.default_rng(0)):
        simulator.reset(*start)
        frames = [simulator.observe()]
        for action in (Action.FORWARD, Action.LEFT):
            simulator.step(action)
            frames.insert(0, simulator.observe())
        samples.append(_sample(frames, simulator.camera, model))
    return collate(samples)


def _sample(frames: list[Frame], camera: Camera, model: DepthModel) -> Batch:
    """Create a sample without batch dimension from frames, the target first."""
    target, *sources = frames
    images = np.stack([frame.rgb for frame in frames]).transpose(0, 3, 1, 2)
    points = sample_sparse(target.rgb, target.depth, SparseSettings())
    sparse_depth = torch.from_numpy(points)[None]
    motions = np.stack([source_from_target(target.pose, source.pose) for source in sources])
    colors = torch.from_numpy(images).float() / 255.0
    return Batch(
        image=colors[0],
        sources=colors[1:],
        sparse_depth=sparse_depth,
        validity=(sparse_depth > 0).float(),
        input_sparse_depth=sparse_depth,
        intrinsics=torch.from_numpy(camera.intrinsics).float(),
        source_from_target=torch.from_numpy(motions).float(),
        ground_truth=torch.from_numpy(target.depth)[None],
        prepared={name: torch.from_numpy(value) for name, value in model.prepare(points).items()},
    )


def batch_on(device: torch.device, batch: Batch) -> Batch:
    """Copy of a batch with all tensors on a device."""
    tensors = {name: value.to(device) for name, value in vars(batch).items() if isinstance(value, torch.Tensor)}
    return replace(batch, **tensors, prepared={name: value.to(device) for name, value in batch.prepared.items()})
