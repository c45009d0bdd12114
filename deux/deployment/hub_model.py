"""Download and upload of models by the mixin of the package huggingface-hub (extra `hub`)."""

from pathlib import Path
from typing import Any

from huggingface_hub import ModelHubMixin, hf_hub_download

from deux.contracts import DepthModel
from deux.deployment.model_files import MODEL_FILE, ModelConfig
from deux.deployment.model_folders import CARD_FILE, CONFIG_FILE, read_folder, write_folder
from deux.errors import DeuxError, first_line
from deux.io.atomic import write_atomically


class HubModel(ModelHubMixin, library_name="deux", pipeline_tag="depth-estimation"):
    """Wrapper of a depth model with huggingface-hub's interface to save, upload and download models.

    Args:
        model: the depth model.
        model_config: its configuration; None if it will not be saved. The mixin reserves the name `config`.
        licence: licence of the weights.
        card: content of an existing README.md; None to write one.
    """

    def __init__(
        self,
        model: DepthModel,
        model_config: ModelConfig | None = None,
        licence: str = "mit",
        card: bytes | None = None,
    ) -> None:
        self.model = model
        self._model_config = model_config
        self._licence = licence
        self._card = card

    def _save_pretrained(self, save_directory: Path) -> None:
        """Write the folder, including the card, since the mixin uploads from a temporary folder."""
        assert self._model_config is not None
        if self._card is not None:
            write_atomically(save_directory / CARD_FILE, self._card)
        write_folder(self.model, self._model_config, save_directory, self._licence)

    @classmethod
    def _from_pretrained(cls, *, model_id: str, **download: Any) -> "HubModel":
        """Download the files of a model and load it."""
        config, _ = (Path(hf_hub_download(model_id, name, **download)) for name in (CONFIG_FILE, MODEL_FILE))
        return cls(read_folder(config.parent))


def download(model_id: str, **options: Any) -> DepthModel:
    """Download the model "owner/name" from the hub; see `deux.from_pretrained`.

    Raises:
        DeuxError: there is no such model, or the hub cannot be reached.
    """
    try:
        return HubModel.from_pretrained(model_id, **options).model
    except DeuxError:
        raise
    except Exception as error:  # huggingface-hub raises errors of many types
        raise DeuxError(
            f"there is no folder {model_id}, and no model of deux could be downloaded under this name from the Hugging "
            f"Face hub ({first_line(error)}): download its files by other means and give their folder."
        ) from error


def push_to_hub(model: DepthModel, config: ModelConfig, folder: Path, licence: str, **options: Any) -> None:
    """Write a model's folder and upload it; `options` are those of `ModelHubMixin.save_pretrained`.

    Raises:
        DeuxError: the folder cannot be written, or the upload fails.
    """
    card = folder / CARD_FILE
    try:
        hub_model = HubModel(model, config, licence, card.read_bytes() if card.exists() else None)
        hub_model.save_pretrained(folder, **options)
    except DeuxError:
        raise
    except Exception as error:  # huggingface-hub raises errors of many types
        raise DeuxError(f"{folder} was not uploaded to the Hugging Face hub ({first_line(error)}).") from error
