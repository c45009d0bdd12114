"""Trained models as folders in the Hugging Face hub's format: config.json, model.safetensors and README.md."""

import importlib
import json
import re
from functools import partial
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any

from deux.contracts import DepthModel
from deux.deployment.model_files import (
    MODEL_FILE,
    ModelConfig,
    make_model,
    model_config,
    save_model,
    stored_config,
    weights_file,
)
from deux.errors import DeuxError
from deux.io.atomic import make_folder, read_bytes, write_atomically

CONFIG_FILE = "config.json"
"""File with the model's configuration."""

CARD_FILE = "README.md"
"""File of the model card."""

HUB_ID = re.compile(r"[\w-][\w.-]*/[\w-][\w.-]*", re.ASCII)
"""Identifier of a model on the hub: "owner/name"."""


def load(path: str | PathLike[str]) -> DepthModel:
    """Load a trained model.

    Args:
        path: a run folder, a model file, a folder that `save_pretrained` wrote, or the name of a shipped model
            (`deux.available`).

    Returns:
        The model on the CPU, in eval mode; `model.save_pretrained(folder)` writes it to a folder for sharing.

    Raises:
        DeuxError: there is no such file, it is damaged or not written by deux, its model is not installed, or its
            weights do not fit the model.

    Example:
        >>> model = deux.load("outputs/runs/kbnet-deux-1a2b3c4d")  # a run folder, or a model file
        >>> model.max_depth
        10.0
    """
    config = model_config(path)
    return bind_save_pretrained(make_model(config, weights_file(path)), config)


def from_pretrained(source: str | PathLike[str], **hub_options: Any) -> DepthModel:
    """Load a model that `model.save_pretrained` wrote, from a folder or from the Hugging Face hub.

    Nothing in the folder is executed: the weights are safetensors, the rest is JSON, and options are checked like those
    of the command line.

    Args:
        source: the folder, any other path that `deux.load` accepts, or "owner/name" on the hub, which needs the package
            huggingface-hub: pip install "deux[hub]". If a local folder "owner" exists, "owner/name" is a path in it,
            unless `hub_options` are given.
        **hub_options: options of the download: revision, token, cache_dir, local_files_only, force_download.

    Returns:
        The model on the CPU, in eval mode.

    Raises:
        DeuxError: there is no such model, the hub cannot be reached, a file is damaged, or the settings or weights are
            do not fit an installed model.

    Example:
        >>> folder = deux.load("outputs/runs/kbnet-deux-1a2b3c4d").save_pretrained("shared/kbnet")
        >>> model = deux.from_pretrained("shared/kbnet")
    """
    if (Path(source) / CONFIG_FILE).is_file():
        return read_folder(Path(source))
    is_path = Path(source).exists() or (Path(source).parent.is_dir() and not hub_options)
    if isinstance(source, str) and HUB_ID.fullmatch(source) and not is_path:
        return _hub(f"there is no folder {source}, and models of the hub take").download(source, **hub_options)
    return load(source)


def save_pretrained(
    model: DepthModel, config: ModelConfig, folder: str | PathLike[str], licence: str = "mit", **hub_options: Any
) -> Path:
    """Write a model to a folder that `from_pretrained` reads; loaded models have it as the method `save_pretrained`.

    Args:
        model: the depth model; already bound in the method.
        config: the model's configuration; already bound in the method.
        folder: the folder, which is created if it does not exist. An existing model in it is replaced; an existing
            README.md is not.
        licence: licence of the weights, the hub's identifier.
        **hub_options: options of `huggingface_hub.ModelHubMixin.save_pretrained`, to upload the folder as well:
            push_to_hub=True, repo_id="owner/name", private, token, commit_message, ...

    Returns:
        The folder.

    Raises:
        DeuxError: the folder cannot be written, or the hub cannot be reached.
    """
    folder = Path(folder)
    if hub_options:
        _hub("uploading a model to the hub takes").push_to_hub(model, config, folder, licence, **hub_options)
    else:
        write_folder(model, config, folder, licence)
    return folder


def bind_save_pretrained(model: DepthModel, config: ModelConfig) -> DepthModel:
    """Add the method `save_pretrained` to a model, and return the model."""
    model.save_pretrained = partial(save_pretrained, model, config)
    return model


def write_folder(model: DepthModel, config: ModelConfig, folder: Path, licence: str) -> None:
    """Write the three files of a model; see `save_pretrained`.

    config.json, which is written last, repeats the configuration in the header of the weights.
    """
    make_folder(folder)
    save_model(folder / MODEL_FILE, model, config.name, config.settings)
    saved = model_config(folder / MODEL_FILE)
    if not (folder / CARD_FILE).exists():
        write_atomically(folder / CARD_FILE, model_card(saved, folder.resolve().name, licence).encode())
    write_atomically(folder / CONFIG_FILE, (saved.to_json(indent=2) + "\n").encode())


def read_folder(folder: Path) -> DepthModel:
    """Load a model from its config.json and model.safetensors; see `from_pretrained`."""
    file = folder / CONFIG_FILE
    config = ModelConfig.from_json(read_bytes(file), file)
    weights = folder / MODEL_FILE
    if not weights.is_file():
        raise DeuxError(f"{folder} has a {CONFIG_FILE} and no {MODEL_FILE}, which holds the weights.")
    stored = stored_config(weights)
    if stored is not None and (stored.name, stored.settings) != (config.name, config.settings):
        raise DeuxError(
            f"{file} and the header of {weights.name} beside it name different models or settings: the folder was "
            "written by halves or edited, so write it again by save_pretrained."
        )
    return bind_save_pretrained(make_model(config, weights), config)


def model_card(config: ModelConfig, title: str, licence: str) -> str:
    """The content of a model's README.md: the hub's header, the model's options and an example.

    Args:
        config: the model's configuration.
        title: title of the page.
        licence: licence of the weights.
    """
    header = {
        "license": licence,
        "library_name": "deux",
        "pipeline_tag": "depth-estimation",
        "tags": ["depth-completion", config.name],
    }
    options = (f"| `{name}` | `{json.dumps(value)}` |" for name, value in config.settings.items())
    # JSON is YAML, and quoted values are read as text.
    lines = ["---", *(f"{key}: {json.dumps(value)}" for key, value in header.items()), "---", ""]
    lines += [f"# {title}", "", f"Depth completion by `{config.name}`, written by deux {config.version}.", ""]
    lines += ["```python", "import deux", "", 'model = deux.from_pretrained("THIS_FOLDER")', ""]
    lines += ["# H x W x 3 colours, H x W metres (0 = none) and a 3 x 3 camera matrix give H x W metres."]
    lines += ["depth = deux.predict(image, sparse_depth, intrinsics, model=model)", "```", ""]
    lines += ["| option | value |", "|---|---|", *options, ""]
    return "\n".join(lines)


def _hub(what: str) -> ModuleType:
    """Import `deux.deployment.hub_model`, which needs a package; the error message begins with `what`."""
    if find_spec("huggingface_hub") is None:
        raise DeuxError(f'{what} the package huggingface-hub: install it with pip install "deux[hub]".')
    return importlib.import_module("deux.deployment.hub_model")
