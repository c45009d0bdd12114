"""From a run to what ships: both files, and a card that says what was measured."""

import json
import sys
from pathlib import Path

import pytest
import torch
from safetensors import safe_open

from deux.bench import shipping
from deux.deployment.model_files import load_model, save_model
from deux.deployment.shipped_models import CARD_KEY
from deux.io.json_files import checked_record
from deux.metrics.point_conditions import PointCondition
from deux.registry import registry
from deux.report.model_card import ModelCard

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("data", "collection")]

SMALL = {"image_filters": (4,) * 5, "depth_filters": (4,) * 5, "decoder_filters": (4,) * 5}


def make_run(folder: Path, steps: int, start: str | None = None) -> Path:
    """What a training leaves in its run folder, as far as a card needs it."""
    (folder / ".hydra").mkdir(parents=True)
    (folder / ".hydra" / "overrides.yaml").write_text(f"- task=train\n- training.steps={steps}\n")
    training = {"steps": steps, "supervised": True, **({"start": start} if start else {})}
    (folder / "run.json").write_text(json.dumps({"training": training, "seed": 3, "training_data": "some/rooms"}))
    save_model(folder / "model.safetensors", registry().create("depth_models", "kbnet", SMALL), "kbnet", SMALL)
    return folder


def read_card(file: Path) -> ModelCard:
    """The card in a model file's header."""
    with safe_open(file, framework="np") as stream:
        return checked_record(json.loads(stream.metadata()[CARD_KEY]), ModelCard, file)


@pytest.fixture
def arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    from void_layout import dataset

    monkeypatch.setattr(shipping, "CONDITIONS", (PointCondition("uniform", 0.05), PointCondition("grid", 0.02)))
    frames = dataset(tmp_path / "toy", split="test")
    first = make_run(tmp_path / "first", 10)
    run = make_run(tmp_path / "second", 5, start=str(first))
    what = ["--name", "toy-indoor", "--summary", "For toys.", "--output", str(tmp_path / "weights"), "--count", "3"]
    return [str(run), *what, "--frames", f"A toy room: evaluation.data={frames}"]


def test_the_weights_and_the_card_are_written(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert shipping.main(arguments) == 0
    file = tmp_path / "weights" / "toy-indoor.safetensors"
    card = read_card(file)
    assert file.with_suffix(".md").read_text() == card.markdown()
    assert card.command == "python -m deux task=train training.steps=10 && python -m deux task=train training.steps=5"
    assert (card.steps, card.seed, card.supervised, card.data) == (15, 3, True, "recorded frames (rooms)")
    assert [(one.frames, one.images, one.pattern) for one in card.errors] == [
        ("A toy room", 3, "uniform"),
        ("A toy room", 3, "grid"),
    ]
    assert "A toy room" in capsys.readouterr().out
    shipped, trained = load_model(file).state_dict(), load_model(tmp_path / "second").state_dict()
    for name, value in trained.items():
        torch.testing.assert_close(shipped[name], value.half().float(), rtol=0, atol=0)


def test_mistakes_are_one_sentence(arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert shipping.main([*arguments[:-1], "without a title"]) == 1
    assert "no title" in capsys.readouterr().err
    (tmp_path / "second" / "run.json").unlink()
    assert shipping.main(arguments) == 1
    assert "run.json is missing" in capsys.readouterr().err
