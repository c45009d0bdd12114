"""The training objective: a weighted sum of loss terms, chosen in the configuration (Eq. 7)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from deux.broken_contracts import broken_contract
from deux.contracts import (
    Batch,
    DepthModel,
    LossInputs,
    LossNeed,
    LossSettings,
    LossTerm,
    Prediction,
    Reconstructions,
)
from deux.errors import DeuxError, kind_of, shown, sizes
from deux.geometry.reprojection import reproject
from deux.inference.precision import tf32_convolutions
from deux.registry import registry
from deux.training.pose_source import PoseSource, RelativePoses


class Losses(NamedTuple):
    """The objective's values for one batch.

    Args:
        total: the weighted sum, a float32 scalar.
        terms: each term's unweighted value by its registered name, detached.
        reconstructions: the rebuilt target frames; None if no term needs them.
    """

    total: Tensor
    terms: dict[str, Tensor]
    reconstructions: Reconstructions | None


class Objective(nn.Module):
    """Weighted sum of loss terms, always computed in full float32, not in TensorFloat-32.

    Reconstructions are computed once, if any term needs them. Ground truth is removed from the batch before it is
    passed to the terms, unless the model is supervised.

    Args:
        terms: weight and term by name.
        depth_range: least and greatest depth in metres that the model predicts.
        supervised: whether the terms may read ground truth.
        model: what error messages call the depth model.

    Raises:
        DeuxError: there is no term, or a term needs ground truth that it must not have.
    """

    def __init__(
        self,
        terms: Mapping[str, tuple[float, LossTerm]],
        depth_range: tuple[float, float],
        supervised: bool = False,
        model: str = "the depth model",
    ) -> None:
        super().__init__()
        if not terms:
            raise DeuxError("the objective has no terms: give at least one loss term a weight above 0.")
        self.weights = {name: weight for name, (weight, _) in terms.items()}
        self.terms = {name: term for name, (_, term) in terms.items()}
        self.depth_range = depth_range
        self.supervised = supervised
        self.model = model
        # Registers the parameters and buffers of terms that are modules, for devices and checkpoints.
        self.term_modules = nn.ModuleDict({n: t for n, t in self.terms.items() if isinstance(t, nn.Module)})
        for name in self._needing(LossNeed.GROUND_TRUTH):
            if not supervised:
                raise DeuxError(
                    f"objective.{name} reads ground truth, but the model is unsupervised: "
                    f"remove the term with objective.{name}=null, choose a supervised model or set "
                    "training.supervised=true."
                )

    @property
    def needs_reconstructions(self) -> bool:
        """Whether some term compares frames, so that relative poses are needed."""
        return self.needs_backward_poses or bool(self._needing(LossNeed.RECONSTRUCTIONS))

    @property
    def needs_backward_poses(self) -> bool:
        """Whether some term needs the poses from the source frames to the target as well."""
        return bool(self._needing(LossNeed.BACKWARD_POSES))

    def forward(self, batch: Batch, prediction: Prediction, poses: RelativePoses | None = None) -> Losses:
        """Compare a prediction with its batch.

        Args:
            batch: the samples.
            prediction: the depth model's output for them, in any precision.
            poses: the relative poses of the reconstructions; the batch's own if None.

        Raises:
            DeuxError: the prediction has the wrong type or shape, or lacks an extra that a term needs; the batch lacks
                ground truth or poses; or a term does not return a scalar. Only shapes and types are checked.
        """
        self._check(batch, prediction)
        with torch.autocast(prediction.depth.device.type, enabled=False), tf32_convolutions(False):
            extras = {name: extra.float() for name, extra in prediction.extras.items()}
            prediction = Prediction(prediction.depth.float(), extras)
            reconstructions = None
            if self.needs_reconstructions:
                poses = poses or PoseSource()(batch, backward=self.needs_backward_poses)
                reconstructions = reconstruct(batch, prediction, poses)
            readable = batch if self.supervised else replace(batch, ground_truth=None)
            inputs = LossInputs(readable, prediction, reconstructions, self.depth_range)
            values = {name: _scalar(name, term(inputs)) for name, term in self.terms.items()}
            total = torch.stack([self.weights[name] * value for name, value in values.items()]).sum()
        return Losses(total, {name: value.detach() for name, value in values.items()}, reconstructions)

    def _needing(self, need: LossNeed) -> list[str]:
        return [name for name, term in self.terms.items() if need in term.needs]

    def _check(self, batch: Batch, prediction: Prediction) -> None:
        if not isinstance(prediction, Prediction):
            raise broken_contract(self.model, kind_of(prediction), "a deux.contracts.Prediction", "forward")
        count, _, height, width = batch.image.shape
        depth, wanted = prediction.depth, (count, 1, height, width)
        if not (isinstance(depth, Tensor) and depth.shape == wanted and depth.is_floating_point()):
            given = f"a prediction whose depth is {kind_of(depth)}"
            right = f"a Tensor of N x 1 x H x W, float32, here {sizes(wanted)}"
            raise broken_contract(self.model, given, right, "forward")
        for name, term in self.terms.items():
            for extra in sorted(term.extras - prediction.extras.keys()):
                known = ", ".join(sorted(prediction.extras)) or "none"
                raise DeuxError(
                    f"objective.{name} needs the extra {extra!r} of the prediction, which {self.model} does not give "
                    f"(its extras: {known}): remove the term with objective.{name}=null."
                )
        for name in self._needing(LossNeed.GROUND_TRUTH):
            if batch.ground_truth is None:
                raise DeuxError(f"objective.{name} needs ground truth, and the training frames come without it.")


def _scalar(name: str, value: Tensor) -> Tensor:
    if isinstance(value, Tensor) and value.ndim == 0 and value.is_floating_point():
        return value
    raise DeuxError(
        f"objective.{name} gives {kind_of(value)}: a loss term gives a Tensor without dimensions, such as a "
        "mean, float32."
    )


def reconstruct(batch: Batch, prediction: Prediction, poses: RelativePoses) -> Reconstructions:
    """Rebuild the target frame from each source frame with the predicted depth (Eq. 1)."""
    images, visible = reproject(batch.sources, prediction.depth, batch.intrinsics, poses.source_from_target)
    return Reconstructions(images, visible, poses.source_from_target, poses.target_from_source)


def make_objective(
    model: DepthModel, overrides: Mapping[str, Any] | None = None, supervised: bool | None = None
) -> Objective:
    """The objective of a depth model: its published terms, changed by the configuration.

    Args:
        model: gives the published terms and weights, and whether ground truth may be read.
        overrides: the configuration's `objective`, see `merge_settings`.
        supervised: whether the terms may read ground truth; None for what the model says.

    Raises:
        DeuxError: a term is not installed or its options are wrong, or its weight is missing or no number.
    """
    if not isinstance(model.objective, Mapping):
        raise DeuxError(
            f"the objective of {registry().called(model)} is {shown(model.objective)}: it must be a mapping, from the "
            "names of loss terms to their weights."
        )
    terms: dict[str, tuple[float, LossTerm]] = {}
    for name, options in merge_settings(model.objective, overrides or {}).items():
        weight = options.pop("weight")
        terms[name] = (weight, registry().create("losses", name, options))
    depth_range = (model.min_depth, model.max_depth)
    supervised = model.supervised if supervised is None else supervised
    return Objective(terms, depth_range, supervised, model=registry().called(model))


def merge_settings(published: LossSettings, overrides: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Lay the configuration's loss settings over a model's published ones.

    A number changes a term's weight and keeps its published options; a mapping changes or adds what it names; null
    or a weight of 0 removes the term.

    Returns:
        For each remaining term, its options together with its "weight".

    Raises:
        DeuxError: a term has no weight, or one that is no number of 0 or more.
    """
    merged = {name: _options(name, setting) for name, setting in published.items()}
    for name, setting in overrides.items():
        merged[name] = {"weight": 0.0} if setting is None else merged.get(name, {}) | _options(name, setting)
    for name, options in merged.items():
        if "weight" not in options:
            raise DeuxError(f"objective.{name} has no weight: set objective.{name}.weight.")
    return {name: options for name, options in merged.items() if options["weight"] > 0}


def _options(name: str, setting: Any) -> dict[str, Any]:
    """One term's setting as a mapping, its weight checked."""
    options = dict(setting) if isinstance(setting, Mapping) else {"weight": setting}
    weight = options.get("weight", 0.0)
    if isinstance(weight, bool) or not isinstance(weight, int | float) or not 0 <= weight < float("inf"):
        raise DeuxError(f"objective.{name} has the weight {weight!r}: a weight is a number of 0 or more, or null.")
    return options
