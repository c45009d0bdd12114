"""Saving and loading of trained models as safetensors files, with the model's name and options in the header."""

import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import safetensors.torch
import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from deux import __version__
from deux.contracts import DepthModel
from deux.deployment.shipped_models import file_or_shipped, shipped_files
from deux.errors import DeuxError, counted, error_text, shown, sizes
from deux.inference.weightless import without_weights
from deux.io.atomic import write_atomically
from deux.io.json_files import checked_record, decode_json
from deux.memory_budget import check_memory
from deux.options import full_settings, without_defaults
from deux.registry import registry

MODEL_FILE = "model.safetensors"
"""Name of the trained model in a run folder."""

METADATA_KEY = "deux"
SHOWN_NAMES = 3
_LONGEST_CONFIG = 100_000  # characters


@dataclass(frozen=True)
class ModelConfig:
    """The configuration of a model, stored with its weights.

    Args:
        name: registered name of the model.
        settings: all options, including defaults.
        version: version of deux that wrote the file.
    """

    name: str
    settings: dict[str, Any]
    version: str

    @classmethod
    def from_json(cls, text: str | bytes, path: Path) -> "ModelConfig":
        """Parse the JSON of `to_json`; `path` is its file, for error messages.

        Raises:
            DeuxError: it is not a configuration.
        """
        return checked_record(decode_json(text.encode() if isinstance(text, str) else text, path), cls, path)

    def to_json(self, indent: int | None = None) -> str:
        """The configuration as JSON."""
        return json.dumps(asdict(self), indent=indent)


def save_model(
    path: str | PathLike[str],
    model: DepthModel,
    name: str,
    settings: Mapping[str, Any],
    half: bool = False,
    header: Mapping[str, str] | None = None,
) -> None:
    """Write a depth model's weights and configuration to a .safetensors file, atomically.

    Args:
        path: the file; its folder must exist.
        model: the depth model.
        name: its registered name.
        settings: the options that it was created with; defaults are filled in.
        half: whether float32 weights are stored in half precision, for a file of half the size; they are loaded as
            float32.
        header: additional entries of the file's header.

    Example:
        >>> model = registry().create("depth_models", "kbnet", {"max_depth": 8})
        >>> save_model("kbnet.safetensors", model, "kbnet", {"max_depth": 8})
    """
    config = ModelConfig(name, full_settings(type(model), settings), __version__)
    weights = {key: value.detach().cpu().contiguous() for key, value in model.state_dict().items()}
    if half:
        weights = {key: value.half() if value.dtype == torch.float32 else value for key, value in weights.items()}
    metadata = {**(header or {}), METADATA_KEY: config.to_json()}
    write_atomically(Path(path), safetensors.torch.save(weights, metadata))


def load_model(path: str | PathLike[str]) -> DepthModel:
    """Load a model that `save_model` wrote.

    Args:
        path: the file, a run folder with a `model.safetensors`, or the name of a shipped model (`available`).

    Returns:
        The model on the CPU, in eval mode.

    Raises:
        DeuxError: there is no such file, it is damaged or not written by deux, its model is not installed, or its
            weights do not fit the model.

    Example:
        >>> model = load_model("outputs/runs/kbnet-deux-1a2b3c4d")  # a run folder
        >>> model.training
        False
    """
    file = weights_file(path)
    return make_model(_read_config(file), file)


def make_model(config: ModelConfig, file: Path) -> DepthModel:
    """Create a model and load its weights from a .safetensors file.

    The weights are compared with the model before memory is allocated for it, so that untrusted options cannot allocate
    more memory than the file's size.

    Returns:
        The model on the CPU, in eval mode.

    Raises:
        DeuxError: the file cannot be read, its model is not installed, an option is wrong, or the weights do not fit.
    """
    weights = _read_weights(file)
    with without_weights():
        problem = misfit(_make(config, file), weights)
    if problem:
        raise DeuxError(
            f"{file} does not fit the {config.name} that is installed: it {problem}; "
            f"it was written by deux {config.version}."
        )
    model = _make(config, file)
    model.load_state_dict(weights)
    return model.eval()


def model_name(path: str | PathLike[str]) -> str:
    """The registered name of a stored model; `path` and errors are as in `load_model`."""
    return model_config(path).name


def model_config(path: str | PathLike[str]) -> ModelConfig:
    """The configuration of a stored model; `path` and errors are as in `load_model`."""
    return _read_config(weights_file(path))


def stored_config(file: Path) -> ModelConfig | None:
    """The model configuration in the header of a .safetensors file; None if there is none.

    Raises:
        DeuxError: the file cannot be read.
    """
    try:
        with safe_open(file, framework="pt") as stream:
            metadata = stream.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise _damaged(file, error) from error
    text = metadata.get(METADATA_KEY, "")
    if not 0 < len(text) <= _LONGEST_CONFIG:
        return None
    try:
        return ModelConfig.from_json(text, file)
    except DeuxError:
        return None


def load_weights(module: nn.Module, weights: Mapping[str, Tensor]) -> str:
    """Load weights into a module if they fit exactly and are finite.

    Returns:
        "" if they were loaded; otherwise which tensors are missing, unexpected, of another shape or type, or not
        finite, as the end of a sentence.
    """
    problem = misfit(module, weights)
    if not problem:
        module.load_state_dict(weights)
    return problem


def misfit(module: nn.Module, weights: Mapping[str, Tensor]) -> str:
    """Why weights do not fit a module, as in `load_weights`; the module may be on the meta device."""
    expected = module.state_dict()
    missing = [key for key in expected if key not in weights]
    unexpected = [key for key in weights if key not in expected]
    reshaped = [
        f"{key}: {sizes(weights[key].shape)} instead of {sizes(expected[key].shape)}"
        for key in expected
        if key in weights and weights[key].shape != expected[key].shape
    ]
    common = [key for key in expected if key in weights]
    tensors = {
        "lacks {}": missing,
        "has {} unexpected": unexpected,
        "has {} of another shape": reshaped,
        "has {} of another type": [
            f"{key}: {weights[key].dtype}" for key in common if _kind(weights[key]) != _kind(expected[key])
        ],
        "has {} with NaN or infinity": [key for key in common if not torch.isfinite(weights[key]).all()],
    }
    problems = [
        f"{text.format(counted(len(names), 'tensor'))} ({_first(names)})" for text, names in tensors.items() if names
    ]
    return ", ".join(problems)


def weights_file(path: str | PathLike[str]) -> Path:
    """The file of a model, from its path, its run folder or the name of a shipped model.

    Raises:
        DeuxError: there is no such model, or `path` is not a path.
    """
    if not isinstance(path, str | PathLike):
        raise DeuxError(
            f"a model cannot be loaded from a value of the type {type(path).__name__}: give the path of a run folder "
            "or model file, or the name of a shipped model."
        )
    file = file_or_shipped(path, Path(path))
    if os.path.isdir(file):
        file = file / MODEL_FILE
    if not os.path.isfile(file):
        shipped = f", or a shipped model ({', '.join(sorted(shipped_files()))})" if shipped_files() else ""
        raise DeuxError(f"there is no model {file}: give a model file, a run folder with a {MODEL_FILE}{shipped}.")
    return file


def _read_config(file: Path) -> ModelConfig:
    config = stored_config(file)
    if config is None:
        raise DeuxError(
            f"{file} has no configuration of a model, so it was not written by deux: load published checkpoints with "
            "deux.load_published(name, path)."
        )
    return config


def _read_weights(file: Path) -> dict[str, Tensor]:
    check_memory(2 * file.stat().st_size, str(file), "it is larger than any model")
    try:
        return safetensors.torch.load_file(file)
    except (SafetensorError, OSError, ValueError) as error:
        raise _damaged(file, error) from error


def _damaged(file: Path, error: Exception) -> DeuxError:
    if zipfile.is_zipfile(file):  # torch.save writes zip archives
        return DeuxError(
            f"{file} cannot be read as safetensors, it seems to be written by torch.save: load published checkpoints "
            "with deux.load_published(name, path) or with model=<name> on the command line; instead of a training's "
            f"checkpoint, give its run folder, which has a {MODEL_FILE} at the end of the training."
        )
    return DeuxError(f"{file} cannot be read as safetensors, it is damaged or something else: {error_text(error)}.")


def _make(config: ModelConfig, file: Path) -> DepthModel:
    """Create the model of a file's configuration."""
    try:
        settings = without_defaults(registry().get("depth_models", config.name), config.settings)
        model: DepthModel = registry().create("depth_models", config.name, settings)
        return model
    except Exception as error:  # the options are untrusted, and constructors may raise anything
        raise DeuxError(
            f"{file} has a {shown(config.name)} that cannot be created here: {error_text(error)}."
        ) from error


def _kind(tensor: Tensor) -> str:
    """The kind of a tensor's numbers, which must not be converted into another; the precision may differ."""
    return "complex" if tensor.is_complex() else "floating point" if tensor.is_floating_point() else "whole"


def _first(names: list[str]) -> str:
    return ", ".join([*names[:SHOWN_NAMES], *(["..."] if len(names) > SHOWN_NAMES else [])])
