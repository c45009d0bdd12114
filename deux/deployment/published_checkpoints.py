"""Checkpoint files as the authors of the depth models published them: read and written."""

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
from deux.options import options
from deux.registry import registry

PREFIX = "module."
"""What DataParallel puts before every name; some published files have it, some do not."""

PUBLISHED_FILE = "model.pth"
"""Name of an exported checkpoint in a run folder."""

RANGE_OPTIONS = frozenset({"min_depth", "max_depth"})
"""Options of a model that its published files were trained with and do not hold."""

log = logging.getLogger(__name__)


@runtime_checkable
class Published(Protocol):
    """A module with a published checkpoint layout: a depth model, or its pose network."""

    def published_modules(self) -> dict[str, nn.Module]:
        """The checkpoint's sub-dictionaries and the modules whose state they hold."""


def load_published(
    name: str,
    path: str | PathLike[str],
    pose_path: str | PathLike[str] | None = None,
    settings: Mapping[str, Any] | None = None,
) -> DepthModel:
    """Make a depth model with the weights of a published checkpoint.

    Args:
        name: the model's registered name, such as "kbnet".
        path: the published checkpoint, such as kbnet-void1500.pth.
        pose_path: the published checkpoint of its pose network. With it, every call of `model.pose_network()` returns
            a new pose network with these weights, in eval mode.
        settings: options of the model where the checkpoint was trained with other than the defaults, its range of
            depths above all (docs/using-a-model.md): the file does not hold them. What they leave out of the model's
            `published_options` is as in these. A warning is logged where the range is left to the defaults.

    Returns:
        The model on the CPU, in eval mode.

    Raises:
        DeuxError: a file cannot be read or is not a checkpoint of this model, or of its pose network.

    Example:
        >>> model = deux.load_published("kbnet", "kbnet-void1500.pth", settings={"max_depth": 8.0})
        >>> depth = deux.predict(image, sparse_depth, intrinsics, model=model)
    """
    model_class: type[DepthModel] = registry().get("depth_models", name)
    chosen = {**model_class.published_options, **(settings or {})}
    model: DepthModel = registry().create("depth_models", name, chosen)
    if not model.published_modules():
        raise DeuxError(f"the depth model {name!r} has no published checkpoints: deux.load(path) reads our own.")
    _load(model, Path(path), name)
    if RANGE_OPTIONS & options(model_class).keys() and not RANGE_OPTIONS & chosen.keys():
        _warn_once(
            f"{path} does not say which range of depths it was trained with, and {name}'s default, {model.min_depth:g} "
            f"to {model.max_depth:g} m, gives wrong depths if that was another one: name it, by "
            'settings={"max_depth": ...} or on the command line model.max_depth=..., even if it is the default.'
        )
    if pose_path is not None:
        pose = model.pose_network()
        if not isinstance(pose, Published):
            raise DeuxError(f"the depth model {name!r} has no published pose network: leave pose_path out.")
        _load(pose, Path(pose_path), f"{name}'s pose network")
        assert isinstance(pose, nn.Module)
        model.pose_network = functools.partial(copy.deepcopy, pose.eval())
    return bind_save_pretrained(model.eval(), ModelConfig(name, chosen, __version__))


def save_published(model: DepthModel, name: str, path: str | PathLike[str]) -> None:
    """Write a depth model as a checkpoint that its published code restores; `load_published` reads it back.

    It holds the weights and, as that code asks for it, a step number, which is 0. There is no state of an optimiser:
    the published code runs the model, but has nothing to resume its training from. A warning is logged where the model
    has other options than that code computes with, `published_options`.

    Args:
        model: the depth model.
        name: its registered name.
        path: the file; its folder must exist.

    Raises:
        DeuxError: the model has no published checkpoints, or the file cannot be written.
    """
    modules = model.published_modules()
    if not modules:
        raise DeuxError(f"the depth model {name!r} has no published code that could load it: export.format=onnx.")
    given = {option: getattr(model, option, value) for option, value in model.published_options.items()}
    if different := {option: value for option, value in given.items() if value != model.published_options[option]}:
        theirs = ", ".join(f"{option}={model.published_options[option]!r}" for option in different)
        ours = ", ".join(f"{option}={value!r}" for option, value in different.items())
        log.warning(
            f"{path} holds a {name} with {ours}, and its published code computes with {theirs}, so that its depth will "
            f"differ; deux.load_published makes the same model again by settings={different}."
        )
    checkpoint: dict[str, Any] = {"train_step": 0}
    for group, module in modules.items():
        weights = module.state_dict().items()
        checkpoint[group] = {model.published_prefix + key: value.detach().cpu().clone() for key, value in weights}
    content = io.BytesIO()
    torch.save(checkpoint, content)
    write_atomically(Path(path), content.getvalue())


@functools.cache
def _warn_once(sentence: str) -> None:
    """Log a sentence, once in each process: a task may load its model several times."""
    log.warning("%s", sentence)


def _load(target: Published, path: Path, label: str) -> None:
    """Fill a model or pose network from a published file; `label` is what messages call it."""
    checkpoint = _read(path)
    modules = target.published_modules()
    missing = [group for group in modules if not isinstance(checkpoint.get(group), Mapping)]
    problems = [f"it lacks {', '.join(missing)}"] if missing else []
    for group, module in modules.items() if not missing else ():
        weights = {str(key).removeprefix(PREFIX): value for key, value in checkpoint[group].items()}
        if not all(isinstance(value, Tensor) for value in weights.values()):
            problems.append(f"{group} holds more than tensors")
        elif problem := load_weights(module, weights):
            problems.append(f"{group} {problem}")
    if problems:
        likeness = _likeness(checkpoint, label)
        raise DeuxError(f"{path} is not a published checkpoint of {label}: {'; '.join(problems)}{likeness}.")


def _read(path: Path) -> Mapping[str, Any]:
    """Read a file of torch.save, without executing what it may contain."""
    if not os.path.isfile(path):
        raise DeuxError(f"there is no checkpoint {path}.")
    checkpoint = read_torch(path)
    if not isinstance(checkpoint, Mapping):
        raise DeuxError(f"{path} holds a {type(checkpoint).__name__} and not a checkpoint's dictionary.")
    return checkpoint


def _likeness(checkpoint: Mapping[str, Any], label: str) -> str:
    """Which installed model has the file's sub-dictionaries, as the end of a sentence; "" if none or the same."""
    names = {str(key) for key in checkpoint}
    layouts = {other: groups for other, groups in _layouts().items() if groups and groups <= names}
    # One model's layout may contain another's: the file looks like the one that explains most of it.
    most = max(map(len, layouts.values()), default=0)
    alike = [other for other, groups in layouts.items() if len(groups) == most]
    return f"; it looks like a checkpoint of {' or '.join(alike)}" if alike and label not in alike else ""


def _layouts() -> dict[str, set[str]]:
    """The sub-dictionaries of every installed model's checkpoint, and of its pose network's."""
    layouts: dict[str, set[str]] = {}
    for name in registry().names("depth_models"):
        try:
            with without_weights():
                model = registry().create("depth_models", name, {})
                pose = model.pose_network()
        except Exception:  # one broken plugin must not hide what is wrong with the file
            continue
        layouts[name] = set(model.published_modules())
        if isinstance(pose, Published):
            layouts[f"{name}'s pose network"] = set(pose.published_modules())
    return layouts
