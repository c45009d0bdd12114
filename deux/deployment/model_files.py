"""Trained models as single files: weights in safetensors, with the model's name and options beside them."""

import json
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
from deux.errors import DeuxError, counted
from deux.io.atomic import write_atomically
from deux.options import full_settings
from deux.registry import registry

MODEL_FILE = "model.safetensors"
"""Name of the trained model in a run folder."""

METADATA_KEY = "deux"
SHOWN_NAMES = 3


@dataclass(frozen=True)
class ModelConfig:
    """What it takes to make the model whose weights a file holds.

    Args:
        name: the model's registered name.
        settings: all its options, defaults included.
        version: version of deux that wrote the file.
    """

    name: str
    settings: dict[str, Any]
    version: str


def save_model(
    path: str | PathLike[str],
    model: DepthModel,
    name: str,
    settings: Mapping[str, Any],
    half: bool = False,
    header: Mapping[str, str] | None = None,
) -> None:
    """Write a depth model's weights and configuration to one .safetensors file, whole or not at all.

    Args:
        path: the file; its folder must exist.
        model: the depth model.
        name: its registered name.
        settings: the options that it was made with; defaults are filled in.
        half: write float32 weights in half precision, 10 bits of mantissa, for a file of half the size. They are read
            as float32 again.
        header: further text by key for the file's header.

    Example:
        >>> model = registry().create("depth_models", "kbnet", {"max_depth": 8})
        >>> save_model("kbnet.safetensors", model, "kbnet", {"max_depth": 8})
    """
    config = ModelConfig(name, full_settings(type(model), settings), __version__)
    weights = {key: value.detach().cpu().contiguous() for key, value in model.state_dict().items()}
    if half:
        weights = {key: value.half() if value.dtype == torch.float32 else value for key, value in weights.items()}
    metadata = {**(header or {}), METADATA_KEY: json.dumps(asdict(config))}
    write_atomically(Path(path), safetensors.torch.save(weights, metadata))


def load_model(path: str | PathLike[str]) -> DepthModel:
    """Read a model that `save_model` wrote.

    Args:
        path: the file, a run folder that holds `model.safetensors`, or the name of a model that ships (`available`).

    Returns:
        The model on the CPU, in eval mode.

    Raises:
        DeuxError: there is no such file, it is damaged or not one of ours, its model is not installed, or its weights
            do not fit the model.

    Example:
        >>> model = deux.load("outputs/runs/kbnet-deux-1a2b3c4d")  # a run folder, or a model file
        >>> model.max_depth
        10.0
    """
    file = weights_file(path)
    config = _read_config(file)
    try:
        model: DepthModel = registry().create("depth_models", config.name, config.settings)
    except DeuxError as error:
        raise DeuxError(f"{file} holds a {config.name} that cannot be made here: {error}") from error
    problem = load_weights(model, safetensors.torch.load_file(file))
    if problem:
        raise DeuxError(
            f"{file} does not fit the {config.name} that is installed: it {problem}; "
            f"it was written by deux {config.version}."
        )
    return model.eval()


def model_name(path: str | PathLike[str]) -> str:
    """The registered name of the model that `path` names; raises as `load_model` does."""
    return model_config(path).name


def model_config(path: str | PathLike[str]) -> ModelConfig:
    """What makes the model that `path` names; raises as `load_model` does."""
    return _read_config(weights_file(path))


def load_weights(module: nn.Module, weights: Mapping[str, Tensor]) -> str:
    """Load weights into a module if they fit it exactly.

    Returns:
        "" if they were loaded; otherwise what is missing, unexpected or of another shape, as the rest of a sentence.
    """
    expected = module.state_dict()
    missing = [key for key in expected if key not in weights]
    unexpected = [key for key in weights if key not in expected]
    reshaped = [
        f"{key}: {_shape(weights[key])} instead of {_shape(expected[key])}"
        for key in expected
        if key in weights and weights[key].shape != expected[key].shape
    ]
    if not (missing or unexpected or reshaped):
        module.load_state_dict(weights)
    found = {
        "lacks {}": missing,
        "has {} unexpected": unexpected,
        "has {} of another shape": reshaped,
    }
    problems = [f"{text.format(_count(names))} ({_first(names)})" for text, names in found.items() if names]
    return ", ".join(problems)


def weights_file(path: str | PathLike[str]) -> Path:
    """The file of a model that is named by it, by its run folder or, if it ships, by its name.

    Raises:
        DeuxError: there is none.
    """
    file = file_or_shipped(path, Path(path))
    if file.is_dir():
        file = file / MODEL_FILE
    if not file.is_file():
        shipped = f", or a model that ships ({', '.join(sorted(shipped_files()))})" if shipped_files() else ""
        raise DeuxError(f"there is no model {file}: name a file of weights, a run folder with a {MODEL_FILE}{shipped}.")
    return file


def _read_config(file: Path) -> ModelConfig:
    try:
        with safe_open(file, framework="pt") as stream:
            metadata = stream.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise DeuxError(f"{file} cannot be read as safetensors, it is damaged or something else: {error}.") from error
    try:
        return ModelConfig(**json.loads(metadata[METADATA_KEY]))
    except (KeyError, TypeError, ValueError) as error:
        raise DeuxError(
            f"{file} does not say which model it holds: it was not written by deux; "
            "published checkpoints are read by deux.load_published(name, path)."
        ) from error


def _count(names: list[str]) -> str:
    return counted(len(names), "tensor")


def _first(names: list[str]) -> str:
    return ", ".join([*names[:SHOWN_NAMES], *(["..."] if len(names) > SHOWN_NAMES else [])])


def _shape(tensor: Tensor) -> str:
    return " x ".join(map(str, tensor.shape)) or "a single number"
