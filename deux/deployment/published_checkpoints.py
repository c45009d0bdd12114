"""Loading and saving of checkpoints in the format of the depth models' published code."""

import copy
import functools
import io
import logging
import os
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor, nn

from deux import __version__
from deux.contracts import DepthModel
from deux.deployment.model_files import ModelConfig, load_weights
from deux.deployment.model_folders import bind_save_pretrained
from deux.errors import DeuxError
from deux.inference.weightless import without_weights
from deux.io.atomic import write_atomically
from deux.io.torch_files import read_torch
from deux.log_once import warn_once
from deux.options import options
from deux.registry import registry

PREFIX = "module."
"""Prefix of DataParallel, which some published files have."""

PUBLISHED_FILE = "model.pth"
"""File of an exported checkpoint in a run folder."""

RANGE_OPTIONS = frozenset({"min_depth", "max_depth"})
"""Options for the depth range of a training, which published files do not contain."""

log = logging.getLogger(__name__)


@runtime_checkable
class Published(Protocol):
    """A depth model or pose network with a published checkpoint format."""

    def published_modules(self) -> dict[str, nn.Module]:
        """The modules whose states are in the checkpoint, by key of the checkpoint."""


def load_published(
    name: str,
    path: str | PathLike[str],
    pose_path: str | PathLike[str] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> DepthModel:
    """Load a depth model from a published checkpoint.

    Args:
        name: the model's registered name, such as "kbnet".
        path: the published checkpoint, such as kbnet-void1500.pth.
        pose_path: the published checkpoint of its pose network. With it, every call of `model.pose_network()` returns
            a new pose network with these weights, in eval mode.
        settings: options with which the checkpoint was trained, above all its depth range (docs/using-a-model.md), as
            the file does not contain them. Others are taken from the model's `published_options`, then from its
            defaults. A warning is logged if the depth range is not given.

    Returns:
        The model on the CPU, in eval mode.

    Raises:
        DeuxError: a file cannot be read, or is not a checkpoint of this model or its pose network.

    Example:
        >>> model = deux.load_published("kbnet", "kbnet-void1500.pth", settings={"max_depth": 8.0})
        >>> depth = deux.predict(image, sparse_depth, intrinsics, model=model)
    """
    model_class: type[DepthModel] = registry().get("depth_models", name)
    chosen = {**model_class.published_options, **(settings or {})}
    model: DepthModel = registry().create("depth_models", name, chosen)
    if not model.published_modules():
        raise DeuxError(f"the depth model {name!r} has no published checkpoints: load its model files by deux.load.")
    _load(model, Path(path), name)
    if RANGE_OPTIONS & options(model_class).keys() and not RANGE_OPTIONS & chosen.keys():
        warn_once(
            log,
            f"{path} does not contain the depth range of its training, and {name}'s default of {model.min_depth:g} to "
            f"{model.max_depth:g} m gives wrong depths if another one was used: set it, even to the default, by "
            'settings={"max_depth": ...} or model.max_depth=... on the command line.',
        )
    if pose_path is not None:
        pose = model.pose_network()
        if not isinstance(pose, Published):
            raise DeuxError(f"the depth model {name!r} has no published pose network: leave out pose_path.")
        _load(pose, Path(pose_path), f"{name}'s pose network")
        assert isinstance(pose, nn.Module)
        model.pose_network = functools.partial(copy.deepcopy, pose.eval())
    return bind_save_pretrained(model.eval(), ModelConfig(name, chosen, __version__))


def save_published(model: DepthModel, name: str, path: str | PathLike[str]) -> None:
    """Save a depth model as a checkpoint for its published code; `load_published` reads it as well.

    It contains the weights and a step number of 0, which that code requires. It contains no optimiser state, so that
    the published code can run the model, but not resume its training. A warning is logged if the model's options differ
    from those of that code, `published_options`.

    Args:
        model: the depth model.
        name: its registered name.
        path: the file; its folder must exist.

    Raises:
        DeuxError: the model has no published checkpoints, or the file cannot be written.
    """
    modules = model.published_modules()
    if not modules:
        raise DeuxError(f"the depth model {name!r} has no published code that could load it: use export.format=onnx.")
    published = model.published_options
    values = {option: getattr(model, option, value) for option, value in published.items()}
    if different := {option: value for option, value in values.items() if value != published[option]}:
        own_text = ", ".join(f"{option}={value!r}" for option, value in different.items())
        published_text = ", ".join(f"{option}={published[option]!r}" for option in different)
        log.warning(
            f"{path} is a {name} with {own_text}, but its published code uses {published_text}, so that its depth will "
            f"differ: load it by deux.load_published with settings={different} for the same depth."
        )
    checkpoint: dict[str, Any] = {"train_step": 0}
    for group, module in modules.items():
        weights = module.state_dict().items()
        checkpoint[group] = {model.published_prefix + key: value.detach().cpu().clone() for key, value in weights}
    content = io.BytesIO()
    torch.save(checkpoint, content)
    write_atomically(Path(path), content.getvalue())


def _load(target: Published, path: Path, label: str) -> None:
    """Load the weights of a model or pose network from a published file; `label` is its name in messages."""
    checkpoint = _read(path)
    modules = target.published_modules()
    missing = [group for group in modules if not isinstance(checkpoint.get(group), Mapping)]
    problems = [f"it lacks {', '.join(missing)}"] if missing else []
    for group, module in modules.items() if not missing else ():
        weights = {str(key).removeprefix(PREFIX): value for key, value in checkpoint[group].items()}
        if not all(isinstance(value, Tensor) for value in weights.values()):
            problems.append(f"{group} contains values that are not tensors")
        elif problem := load_weights(module, weights):
            problems.append(f"{group} {problem}")
    if problems:
        likeness = _likeness(checkpoint, label)
        raise DeuxError(f"{path} is not a published checkpoint of {label}: {'; '.join(problems)}{likeness}.")


def _read(path: Path) -> Mapping[str, Any]:
    """Read a file of torch.save without executing code."""
    if not os.path.isfile(path):
        raise DeuxError(f"there is no checkpoint {path}.")
    checkpoint = read_torch(path)
    if not isinstance(checkpoint, Mapping):
        raise DeuxError(f"{path} is a {type(checkpoint).__name__}, but a checkpoint is a dictionary.")
    return checkpoint


def _likeness(checkpoint: Mapping[str, Any], label: str) -> str:
    """Which installed model a checkpoint probably belongs to, as the end of a sentence; "" if none or `label`."""
    names = {str(key) for key in checkpoint}
    layouts = {other: groups for other, groups in _layouts().items() if groups and groups <= names}
    # One model's keys may include another's, so the models with the most matching keys are chosen.
    most = max(map(len, layouts.values()), default=0)
    similar = [other for other, groups in layouts.items() if len(groups) == most]
    return f"; it looks like a checkpoint of {' or '.join(similar)}" if similar and label not in similar else ""


def _layouts() -> dict[str, set[str]]:
    """The keys of the checkpoints of all installed models and their pose networks."""
    layouts: dict[str, set[str]] = {}
    for name in registry().names("depth_models"):
        try:
            with without_weights():
                model = registry().create("depth_models", name, {})
                pose = model.pose_network()
        except Exception:  # a broken plugin must not hide the error about the file
            continue
        layouts[name] = set(model.published_modules())
        if isinstance(pose, Published):
            layouts[f"{name}'s pose network"] = set(pose.published_modules())
    return layouts
