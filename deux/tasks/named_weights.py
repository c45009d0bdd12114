"""Hashes of the weights that options refer to, which are part of a run's identity."""

from contextlib import suppress

from deux.collection.perception import needs_model
from deux.collection.specification import fingerprint_of
from deux.errors import DeuxError
from deux.inference.weightless import without_weights
from deux.registry import PluginChoice
from deux.task_sections import Sections
from deux.tasks.checkpoints import is_pretrained, named_identity
from deux.tasks.model_training import FoundationSettings
from deux.tasks.seed_model import SeedModelSettings
from deux.training.training_settings import TrainingSettings


def named_weights(
    sections: Sections, explorer: bool = True, guide: bool = True, trained: bool = True
) -> dict[str, str]:
    """Hashes of the weights that options refer to, for `deux.tasks.run_folder.open_run_folder`.

    The options contain only paths, and a file may change while its path stays the same.

    Args:
        sections: configuration; reads `model`, `explore`, `seed_model`, `training` and `foundation`.
        explorer: whether the explorer of the section `explore` is used.
        guide: whether the seed model guides that explorer, if it needs a depth model.
        trained: whether the depth model of the section `model` is trained.

    Returns:
        Hashes by option, of the weights that are used and exist.
    """
    model, explore = sections.plugin("model"), sections.plugin("explore")
    hashes: dict[str, str | None] = {}
    from_scratch = []
    if explorer and explore.settings.get("weights") is not None:  # a learned explorer
        hashes["explore.weights"] = _fingerprint(explore)
    if guide and needs_model(explore):
        seed_model = sections.read("seed_model", SeedModelSettings)
        chosen = seed_model.choose(model)
        if seed_model.checkpoint is not None:
            hashes["seed_model.checkpoint"] = _identity(chosen, seed_model.checkpoint)
        elif not is_pretrained(chosen):
            from_scratch.append(chosen)
    if trained:
        start = sections.read("training", TrainingSettings).start
        if start is not None:
            hashes["training.start"] = _identity(model, start)
        else:
            from_scratch.append(model)
    foundation = sections.read("foundation", FoundationSettings).checkpoint
    if foundation is not None and any(map(_has_foundation, from_scratch)):
        hashes["foundation.checkpoint"] = _identity(model, foundation)
    return {option: identity for option, identity in hashes.items() if identity is not None}


def _identity(published: PluginChoice, path: str) -> str | None:
    with suppress(DeuxError):  # a missing file is reported where it is loaded
        return named_identity(published, path)
    return None


def _fingerprint(explorer: PluginChoice) -> str | None:
    with suppress(DeuxError):
        return fingerprint_of(explorer.create())
    return None


def _has_foundation(model: PluginChoice) -> bool:
    with without_weights():
        return model.create().foundation() is not None
