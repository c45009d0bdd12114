"""The trained models that come with the package: their cards, and what they do in a flat that they never saw."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open

import deux
from deux.configuration import compose, sections_of
from deux.data.dataset_reader import DatasetReader
from deux.deployment.model_files import model_config
from deux.deployment.shipped_models import CARD_KEY, shipped_files
from deux.io.json_files import checked_record
from deux.metrics.point_conditions import PointCondition, errors_under
from deux.report.model_card import ModelCard
from deux.tasks.datasets import Datasets

MOST_BYTES = 40e6
NAMES = sorted(shipped_files())


def read_card(file: Path) -> ModelCard:
    """The card in a model file's header."""
    with safe_open(file, framework="np") as stream:
        return checked_record(json.loads(stream.metadata()[CARD_KEY]), ModelCard, file)


@pytest.fixture(scope="module")
def unseen(tmp_path_factory: pytest.TempPathFactory) -> DatasetReader:
    """A few frames of a flat with a seed of its own, by a camera of 96 x 72 pixels."""
    scenes = ["scenes=apartments", "scenes.test=[987654]", "evaluation.viewpoints=6"]
    camera = ["camera.width=96", "camera.height=72", "camera.hfov=75"]
    outputs = tmp_path_factory.mktemp("unseen")
    sections = sections_of(compose(["task=evaluate", *scenes, *camera, f"paths.outputs={outputs}"]))
    return DatasetReader(Datasets(sections, ["test"]).viewpoints("test", 6))


def test_they_are_small_enough_together() -> None:
    assert sorted(deux.available()) == NAMES
    assert sum(file.stat().st_size for file in shipped_files().values()) < MOST_BYTES


@pytest.mark.parametrize("name", NAMES)
def test_the_page_agrees_with_the_header(name: str) -> None:
    file = shipped_files()[name]
    card = read_card(file)
    assert file.with_suffix(".md").read_text() == card.markdown()
    assert deux.available()[name] == card.summary
    assert (card.name, card.model) == (name, model_config(name).name)
    assert not [part for part in card.command.split() if Path(part.split("=")[-1]).is_absolute()]


@pytest.mark.parametrize("name", NAMES)
def test_it_beats_interpolation_on_its_card(name: str) -> None:
    """What it has to, to ship: in MAE and RMSE with 1 % of points in generated scenes."""
    generated = [one for one in read_card(shipped_files()[name]).errors if "generated" in one.frames]
    clean = [one for one in generated if (one.pattern, one.density, one.noise) == ("corners", 0.01, 0.0)]
    assert {one.frames for one in clean} == {one.frames for one in generated}
    for metric in ("mae", "rmse"):
        assert np.mean([one.metrics[metric] for one in clean]) < np.mean([one.baseline[metric] for one in clean])


@pytest.mark.parametrize("name", NAMES)
def test_it_beats_interpolation_in_a_flat_that_it_never_saw(name: str, unseen: DatasetReader) -> None:
    for condition in (PointCondition("corners", 0.0025), PointCondition("corners", 0.01, noise=0.02, outliers=0.02)):
        found = errors_under(condition, deux.load(name), unseen)
        assert found.images >= 4
        assert found.metrics["mae"] < found.baseline["mae"]
        assert found.metrics["rmse"] < found.baseline["rmse"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [(48, 64), (97, 131), (240, 320)])
def test_it_predicts_at_any_size(name: str, size: tuple[int, int]) -> None:
    """A plane in front of the camera, seen by 1 % of its points, is a plane."""
    height, width = size
    points = np.where(np.random.default_rng(0).random(size) < 0.01, 2.0, 0.0).astype(np.float32)
    intrinsics = np.array([[width / 1.5, 0, (width - 1) / 2], [0, width / 1.5, (height - 1) / 2], [0, 0, 1]])
    image = np.random.default_rng(1).integers(100, 156, (height, width, 3), np.uint8)
    with torch.no_grad():
        depth = deux.predict(image, points, intrinsics, model=name)
    assert depth.shape == size
    assert np.median(np.abs(depth - 2.0)) < 0.2
