"""Sources of the relative camera poses for reconstructions: recorded poses, or a pose network."""

import inspect
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

from deux.broken_contracts import broken_contract
from deux.contracts import Batch, DepthModel
from deux.errors import DeuxError, kind_of, near_matches, sizes
from deux.registry import registry

PoseKind = Literal["simulator", "learned"]


class RelativePoses(NamedTuple):
    """Relative poses of the target frame and its source frames, float32.

    Args:
        source_from_target: N x S x 4 x 4, transforms points of the target camera to each source camera.
        target_from_source: N x S x 4 x 4, the opposite direction; None unless requested.
    """

    source_from_target: Tensor
    target_from_source: Tensor | None = None


class PoseSource(nn.Module):
    """Uses the recorded camera poses (`pose=simulator`)."""

    def forward(self, batch: Batch, backward: bool = False) -> RelativePoses:
        """Return the poses of a batch, and their inverses if `backward`.

        Raises:
            DeuxError: the frames have no poses.
        """
        if batch.source_from_target is None:
            raise DeuxError(
                "pose=simulator needs the poses of the frames, and these frames have none: use pose=learned, or "
                "frames of a dataset with absolute_pose/."
            )
        forward = batch.source_from_target.float()
        with torch.autocast(forward.device.type, enabled=False):
            return RelativePoses(forward, _inverse(forward) if backward else None)


class LearnedPoseSource(PoseSource):
    """Estimates poses from pairs of images, by a network that trains together with the depth model (`pose=learned`).

    All source frames pass through the network in one call, so that batch statistics are over all pairs.

    Args:
        network: see `DepthModel.pose_network`.
        model: what error messages call the depth model.
    """

    def __init__(self, network: nn.Module, model: str = "the depth model") -> None:
        super().__init__()
        self.network = network
        self.model = model

    def forward(self, batch: Batch, backward: bool = False) -> RelativePoses:
        """Estimate the poses of a batch; `backward` runs the network a second time on the swapped pairs.

        Raises:
            DeuxError: the network's output has the wrong shape or type.
        """
        sources = batch.sources.flatten(0, 1)
        targets = batch.image[:, None].expand_as(batch.sources).flatten(0, 1)
        shape = batch.sources.shape[:2]
        forward = self._poses(targets, sources).unflatten(0, shape)
        if not backward:
            return RelativePoses(forward)
        return RelativePoses(forward, self._poses(sources, targets).unflatten(0, shape))

    def _poses(self, targets: Tensor, sources: Tensor) -> Tensor:
        """The network's output for N pairs of images, N x 4 x 4 float32."""
        found: object = self.network(targets, sources)
        wanted = (len(targets), 4, 4)
        if isinstance(found, Tensor) and found.shape == wanted and found.is_floating_point():
            return found.float()
        given = f"a network that answers {len(targets)} pairs of images with {kind_of(found)}"
        right = f"a network that answers with a Tensor of N x 4 x 4, float32, here {sizes(wanted)}"
        raise broken_contract(self.model, given, right, "pose_network")


def make_pose_source(kind: PoseKind, model: DepthModel) -> PoseSource:
    """Create a pose source for a depth model.

    Raises:
        DeuxError: the kind is unknown, or it is "learned" and the model has no pose network or one that cannot be
            called with two batches of images.
    """
    if kind == "simulator":
        return PoseSource()
    if kind != "learned":
        raise DeuxError(f"pose={kind} is no source of poses: {near_matches(str(kind), ['simulator', 'learned'])}")
    network, called = model.pose_network(), registry().called(model)
    if network is None:
        raise DeuxError(f"pose=learned needs a pose network, and {called} has none: use pose=simulator.")
    wanted = "an nn.Module whose `forward` takes two batches of images, target_image and source_image, or None"
    if not isinstance(network, nn.Module):
        raise broken_contract(model, kind_of(network), wanted, "pose_network")
    signature = inspect.signature(network.forward)
    try:
        signature.bind(None, None)
    except TypeError:
        given = f"a {type(network).__name__} whose `forward` takes {signature}"
        raise broken_contract(model, given, wanted, "pose_network") from None
    return LearnedPoseSource(network, called)


def _inverse(pose: Tensor) -> Tensor:
    """Inverse of affine matrices ... x 4 x 4, without the synchronisation of `torch.linalg.inv`."""
    x, y, z = pose[..., :3, :3].unbind(-1)
    across = torch.stack([torch.linalg.cross(y, z), torch.linalg.cross(z, x), torch.linalg.cross(x, y)], dim=-2)
    linear = across / (across[..., :1, :] @ x[..., None])
    upper = torch.cat([linear, -linear @ pose[..., :3, 3:]], dim=-1)
    return torch.cat([upper, pose[..., 3:, :]], dim=-2)
