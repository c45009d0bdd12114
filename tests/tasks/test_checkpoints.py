"""Models that a command names by a path."""

from pathlib import Path

from deux.deployment.published_checkpoints import save_published
from deux.registry import registry
from deux.tasks.checkpoints import load_named_model

SMALL = {
    "image_filters": [4, 8, 8, 8, 8],
    "depth_filters": [4] * 5,
    "decoder_filters": [8, 8, 8, 8, 4],
    "max_depth": 9.0,
}


def test_a_published_file_has_no_margin_though_the_configuration_sets_one(tmp_path: Path) -> None:
    path = tmp_path / "model.pth"
    save_published(registry().create("depth_models", "kbnet", SMALL), "kbnet", path)
    chosen = registry().choose("depth_models", {"name": "kbnet", "margin": 4, **SMALL})
    name, model = load_named_model(chosen, str(path))
    assert (name, model.margin, model.max_depth) == ("kbnet", 0, 9.0)  # type: ignore[attr-defined]
