"""Trained models on the Hugging Face hub, by the mixin of its own package; needs the extra `hub`."""

from pathlib import Path
from typing import Any

from huggingface_hub import ModelHubMixin, hf_hub_download

from deux.contracts import DepthModel
from deux.deployment.model_files import MODEL_FILE, ModelConfig
from deux.deployment.model_folders import CARD_FILE, CONFIG_FILE, read_folder, write_folder
from deux.errors import DeuxError
from deux.io.atomic import write_atomically


class HubModel(ModelHubMixin, library_name="deux", pipeline_tag="depth-estimation"):
    """A depth model as the hub's package saves, uploads and downloads one.

    Args:
        model: the depth model.
        made_from: what the model was made from; None for one that is not saved.
        licence: of the weights.
        card: a README.md that is there already; None to write one.
    """

    def __init__(
        self,
        model: DepthModel,
        made_from: ModelConfig | None = None,
        licence: str = "mit",
        card: bytes | None = None,
    ) -> None:
        self.model = model
        self._made_from = made_from
        self._licence = licence
        self._card = card

    def _save_pretrained(self, save_directory: Path) -> None:
        """Write the folder; the mixin uploads another one than it saves, so the card goes into both."""
        assert self._made_from is not None
        if self._card is not None:
            write_atomically(save_directory / CARD_FILE, self._card)
        write_folder(self.model, self._made_from, save_directory, self._licence)

    @classmethod
    def _from_pretrained(cls, *, model_id: str, **download: Any) -> "HubModel":
        """Download the two files that make a model, and read them."""
        config, _ = (Path(hf_hub_download(model_id, name, **download)) for name in (CONFIG_FILE, MODEL_FILE))
        return cls(read_folder(config.parent))


def download(model_id: str, **options: Any) -> DepthModel:
    """The model "owner/name" of the hub; see `deux.from_pretrained`.

    Raises:
        DeuxError: there is no such model, or the hub cannot be reached.
    """
    try:
        return HubModel.from_pretrained(model_id, **options).model
    except DeuxError:
        raise
    except Exception as error:  # of the network, of the hub and of what its own package reads
        raise DeuxError(
            f"there is no folder {model_id}, and no model of deux could be had under that name from the Hugging Face "
            f"hub ({_reason(error)}): download its files by other means and name their folder."
        ) from error


def push_to_hub(model: DepthModel, config: ModelConfig, folder: Path, licence: str, **options: Any) -> None:
    """Write a model's folder and upload it; `options` are of `ModelHubMixin.save_pretrained`.

    Raises:
        DeuxError: the folder cannot be written, or the hub cannot be reached or does not take it.
    """
    card = folder / CARD_FILE
    try:
        shared = HubModel(model, config, licence, card.read_bytes() if card.exists() else None)
        shared.save_pretrained(folder, **options)
    except DeuxError:
        raise
    except Exception as error:  # as above
        raise DeuxError(f"{folder} was not uploaded to the Hugging Face hub ({_reason(error)}).") from error


def _reason(error: Exception) -> str:
    lines = str(error).strip().splitlines() or [""]
    return f"{type(error).__name__}: {lines[0].rstrip('.')}"
