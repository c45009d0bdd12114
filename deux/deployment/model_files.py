"""Trained models as single files: weights in safetensors, with the model's name and options beside them."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import safetensors.torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from deux import __version__
from deux.contracts import DepthModel
from deux.errors import DeuxError, counted
from deux.inference.weightless import without_weights
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

    @classmethod
    def from_json(cls, text: str | bytes) -> "ModelConfig":
        """Read what `to_json` wrote.

        Raises:
            ValueError: it is something else.
        """
        try:
            values = json.loads(text, parse_constant=_no_number)
        except RecursionError as error:
            raise ValueError("too many brackets within brackets") from error
        fields = cls.__dataclass_fields__
        if not isinstance(values, dict) or values.keys() != fields.keys():
            raise ValueError(f"its keys are not {', '.join(fields)}")
        name, settings, version = values["name"], values["settings"], values["version"]
        if not (isinstance(name, str) and isinstance(settings, dict) and isinstance(version, str)):
            raise ValueError("the name and version are not text, or the settings not a table")
        return cls(name, settings, version)

    def to_json(self, indent: int | None = None) -> str:
        """The configuration as JSON."""
        return json.dumps(asdict(self), indent=indent)


def save_model(path: str | PathLike[str], model: DepthModel, name: str, settings: Mapping[str, Any]) -> None:
    """Write a depth model's weights and configuration to one .safetensors file, whole or not at all.

    Args:
        path: the file; its folder must exist.
        model: the depth model.
        name: its registered name.
        settings: the options that it was made with; defaults are filled in.

    Example:
        >>> model = registry().create("depth_models", "kbnet", {"max_depth": 8})
        >>> save_model("kbnet.safetensors", model, "kbnet", {"max_depth": 8})
    """
    config = ModelConfig(name, full_settings(type(model), settings), __version__)
    weights = {key: value.detach().cpu().contiguous() for key, value in model.state_dict().items()}
    metadata = {METADATA_KEY: config.to_json()}
    write_atomically(Path(path), safetensors.torch.save(weights, metadata))


def load_model(path: str | PathLike[str]) -> DepthModel:
    """Read a model that `save_model` wrote.

    Args:
        path: the file, or a run folder that holds `model.safetensors`.

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
    return make_model(_read_config(file), file)


def make_model(config: ModelConfig, file: Path) -> DepthModel:
    """Make a model and fill it with the weights of a .safetensors file.

    The weights are compared with the model before the model is given memory, so that settings from outside cannot ask
    for more of it than the file is large.

    Returns:
        The model on the CPU, in eval mode.

    Raises:
        DeuxError: the file cannot be read, its model is not installed, an option is wrong, or the weights do not fit.
    """
    try:
        weights = safetensors.torch.load_file(file)
    except (SafetensorError, OSError) as error:
        raise _unreadable(file, error) from error
    try:
        with without_weights():
            outline: DepthModel = registry().create("depth_models", config.name, config.settings)
        problem = misfit(outline, weights)
        if not problem:
            model: DepthModel = registry().create("depth_models", config.name, config.settings)
            problem = load_weights(model, weights)
    except Exception as error:  # settings of the right types may have values that no network can be made of
        reason = str(error) if isinstance(error, DeuxError) else f"{' '.join(str(error).split())}."
        raise DeuxError(f"{file} holds a {config.name} that cannot be made here: {reason}") from error
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


def stored_config(file: Path) -> ModelConfig | None:
    """What the header of a .safetensors file says that its model is made from; None if it says nothing.

    Raises:
        DeuxError: the file cannot be read.
    """
    try:
        with safe_open(file, framework="pt") as stream:
            metadata = stream.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise _unreadable(file, error) from error
    try:
        return ModelConfig.from_json(metadata[METADATA_KEY])
    except (KeyError, ValueError):
        return None


def load_weights(module: nn.Module, weights: Mapping[str, Tensor]) -> str:
    """Load weights into a module if they fit it exactly.

    Returns:
        "" if they were loaded; otherwise what `misfit` says.
    """
    problem = misfit(module, weights)
    if not problem:
        module.load_state_dict(weights)
    return problem


def misfit(module: nn.Module, weights: Mapping[str, Tensor]) -> str:
    """Why weights do not fit a module, which may be one without memory for its own.

    Returns:
        "" if they fit exactly; otherwise what is missing, unexpected or of another shape, as the rest of a sentence.
    """
    expected = module.state_dict()
    missing = [key for key in expected if key not in weights]
    unexpected = [key for key in weights if key not in expected]
    reshaped = [
        f"{key}: {_shape(weights[key])} instead of {_shape(expected[key])}"
        for key in expected
        if key in weights and weights[key].shape != expected[key].shape
    ]
    found = {
        "lacks {}": missing,
        "has {} unexpected": unexpected,
        "has {} of another shape": reshaped,
    }
    problems = [f"{text.format(_count(names))} ({_first(names)})" for text, names in found.items() if names]
    return ", ".join(problems)


def weights_file(path: str | PathLike[str]) -> Path:
    """The file of a model that is named by it or by its run folder.

    Raises:
        DeuxError: there is none.
    """
    file = Path(path)
    if file.is_dir():
        file = file / MODEL_FILE
    if not file.is_file():
        raise DeuxError(f"there is no model {file}: name a file of weights or a run folder with a {MODEL_FILE}.")
    return file


def _read_config(file: Path) -> ModelConfig:
    config = stored_config(file)
    if config is None:
        raise DeuxError(
            f"{file} does not say which model it holds: it was not written by deux; "
            "published checkpoints are read by deux.load_published(name, path)."
        )
    return config


def _unreadable(file: Path, error: Exception) -> DeuxError:
    return DeuxError(f"{file} cannot be read as safetensors, it is damaged or something else: {error}.")


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def _count(names: list[str]) -> str:
    return counted(len(names), "tensor")


def _first(names: list[str]) -> str:
    return ", ".join([*names[:SHOWN_NAMES], *(["..."] if len(names) > SHOWN_NAMES else [])])


def _shape(tensor: Tensor) -> str:
    return " x ".join(map(str, tensor.shape)) or "a single number"
