"""Samples with other cameras and other points: they must still be what a camera and a sensor would have seen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from void_layout import dataset as written

from deux.contracts import Batch
from deux.data.augmentation import RandomScale, training_transforms
from deux.data.augmentation_settings import AugmentationSettings
from deux.data.dataset_reader import DatasetReader
from deux.data.device_cache import DeviceCache
from deux.data.frame_cache import FrameCache
from deux.data.triplets import SampleSettings, TripletDataset, collate
from deux.errors import DeuxError
from deux.geometry.reprojection import reproject
from deux.options import construct

SIZES = ((16, 16), (24, 20), (20, 32))
POINTS = AugmentationSettings(density=(0.01, 0.05), patterns=("uniform",))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("augmentation") / "toy")


def load(folder: Path, augmentation: AugmentationSettings, cache: FrameCache | None = None) -> TripletDataset:
    settings = SampleSettings(training=True, ground_truth=True, augmentation=training_transforms(augmentation))
    return TripletDataset([DatasetReader(folder)], "train", settings, cache)


def batches(data: TripletDataset, count: int = 12) -> list[Batch]:
    """Batches of three, each with seeds of its own."""
    return [collate(data.__getitems__([(i % len(data), 1000 * k + i) for i in range(3)])) for k in range(count)]


def test_a_batch_has_one_of_the_sizes(folder: Path) -> None:
    found = {tuple(batch.image.shape[-2:]) for batch in batches(load(folder, AugmentationSettings(sizes=SIZES)))}
    assert found == set(SIZES)


def test_the_camera_follows_the_window(folder: Path) -> None:
    """With true depth, the frames still rebuild one another, whatever was cut out and resized."""
    settings = AugmentationSettings(sizes=((40, 48),), least_view=0.5)
    for batch in batches(load(folder, settings), 4):
        assert batch.ground_truth is not None
        assert batch.source_from_target is not None
        images, visible = reproject(batch.sources, batch.ground_truth, batch.intrinsics, batch.source_from_target)
        error = (images - batch.image[:, None]).abs().mean(dim=2, keepdim=True)
        inside = visible & (batch.ground_truth[:, None] > 0)
        assert float(error[inside].median()) < 0.02


def test_fields_of_view_lie_between_the_least_and_the_frames_own(folder: Path) -> None:
    """The toy camera has f = 24 at 48 x 40 pixels: 2 arctan(W / 2f) is 90 degrees wide."""
    data = load(folder, AugmentationSettings(sizes=((40, 48),), least_view=0.5))
    angles = np.degrees([2 * np.arctan(48 / 2 / float(k[0, 0])) for b in batches(data) for k in b.intrinsics])
    assert 52.0 < angles.min() < 62.0
    assert 80.0 < angles.max() <= 90.01
    for batch in batches(data, 3):
        torch.testing.assert_close(batch.intrinsics[:, 0, 0], batch.intrinsics[:, 1, 1], rtol=0.06, atol=0.0)


def test_a_scene_of_another_size_looks_the_same(folder: Path) -> None:
    """With the scaled depth and poses, the same frames rebuild one another."""
    settings = AugmentationSettings(scale=(0.25, 4.0))
    of_frames, scaled = (batches(load(folder, one)) for one in (AugmentationSettings(), settings))
    factors = []
    for plain, batch in zip(of_frames, scaled, strict=True):
        assert plain.ground_truth is not None
        assert batch.ground_truth is not None
        assert plain.source_from_target is not None
        assert batch.source_from_target is not None
        assert torch.equal(plain.image, batch.image)
        pairs = zip(plain.ground_truth, batch.ground_truth, strict=True)
        of_sample = [float((after[before > 0] / before[before > 0]).mean()) for before, after in pairs]
        factor = torch.tensor(of_sample)[:, None, None, None]
        for name in ("ground_truth", "sparse_depth", "input_sparse_depth"):
            torch.testing.assert_close(getattr(batch, name), factor * getattr(plain, name))
        before, after = (
            reproject(one.sources, one.ground_truth, one.intrinsics, one.source_from_target)[0]  # type: ignore[arg-type]
            for one in (plain, batch)
        )
        torch.testing.assert_close(before, after, rtol=0.0, atol=1e-3)
        factors += of_sample
    assert 0.25 <= min(factors) < 0.4
    assert 2.5 < max(factors) <= 4.0
    assert np.mean(np.log(factors)) == pytest.approx(0.0, abs=3 * np.log(4) / np.sqrt(3 * len(factors)))  # log-uniform


@pytest.mark.parametrize("density", [None, (0.02, 0.02)], ids=["own points", "drawn points"])
def test_no_point_leaves_the_depth_that_the_model_predicts(folder: Path, density: tuple[float, float] | None) -> None:
    """The toy frames' depths lie between 1.3 and 5.1 m: the nearest and the farthest point of each sample decide."""
    near, far = 1.0, 6.0
    given = AugmentationSettings(density=density)
    settings = SampleSettings(
        training=True,
        ground_truth=True,
        augmentation=training_transforms(replace(given, scale=(0.25, 4.0)), depth_range=(near, far)),
    )
    scaled = TripletDataset([DatasetReader(folder)], "train", settings)
    plain = load(folder, given)
    for before, after in zip(batches(plain), batches(scaled), strict=True):
        for depth, other in zip(before.sparse_depth, after.sparse_depth, strict=True):
            points = other[other > 0]
            assert near * 0.9999 <= float(points.min()) < float(points.max()) <= far * 1.0001
            assert len(points) == int((depth > 0).sum())


@pytest.mark.parametrize(
    ("span", "least", "greatest"),
    [
        (None, 0.5, 2.0),
        ((0.3, 4.0), 0.5, 2.0),
        ((0.125, 4.0), 0.8, 2.0),
        ((0.3, 8.0), 0.5, 1.25),
        ((0.1, 10.0), 1.0, 1.0),
        ((0.02, 4.0), 1.0, 2.0),  # already nearer than the model can say: no nearer
        ((0.3, 40.0), 0.5, 1.0),
    ],
)
def test_factors_end_where_a_point_would_leave_the_range(
    span: tuple[float, float] | None, least: float, greatest: float
) -> None:
    scale, generator = RandomScale((0.5, 2.0), (0.1, 10.0)), torch.Generator().manual_seed(0)
    factors = [scale.draw_factor(span, generator) for _ in range(300)]
    assert least <= min(factors) <= least * 1.02
    assert greatest / 1.02 <= max(factors) <= greatest * 1.0000001
    assert np.median(factors) == pytest.approx(np.sqrt(least * greatest), rel=0.12)


def test_factors_that_leave_the_range_at_any_rate_are_the_ones_asked_for() -> None:
    assert RandomScale((0.5, 0.5), (0.1, 10.0)).draw_factor((0.1, 3.0)) == 0.5
    assert RandomScale((2.0, 2.0), (0.1, 10.0)).draw_factor((1.0, 9.0)) == 2.0


def test_points_are_taken_from_the_ground_truth(folder: Path) -> None:
    counts = []
    for batch in batches(load(folder, POINTS)):
        assert batch.ground_truth is not None
        there = batch.sparse_depth > 0
        torch.testing.assert_close(batch.sparse_depth[there], batch.ground_truth[there])
        torch.testing.assert_close(batch.input_sparse_depth, batch.sparse_depth)
        torch.testing.assert_close(batch.validity, there.float())
        counts += [int(one.count_nonzero()) for one in batch.sparse_depth]
    assert 19 <= min(counts) < 30
    assert 60 < max(counts) <= 96
    assert np.mean(np.array(counts) < 1920 * np.sqrt(0.01 * 0.05)) == pytest.approx(0.5, abs=0.25)  # log-uniform


def test_noise_and_outliers_are_drawn_for_each_sample(folder: Path) -> None:
    settings = AugmentationSettings(density=(0.2, 0.2), patterns=("uniform",), noise=0.05, outliers=0.1)
    deviations = []
    for batch in batches(load(folder, settings)):
        assert batch.ground_truth is not None
        for sparse, truth in zip(batch.sparse_depth, batch.ground_truth, strict=True):
            ratio = sparse[sparse > 0] / truth[sparse > 0]
            deviations.append(float((ratio - 1).abs().median() / 0.6745))
    assert min(deviations) < 0.015
    assert 0.03 < max(deviations) < 0.07


def test_a_seed_gives_the_same_sample_and_another_one_does_not(folder: Path) -> None:
    settings = AugmentationSettings(sizes=((24, 24),), least_view=0.5, flip=0.5, colors=0.3, density=(0.02, 0.1))
    data = load(folder, settings)
    one, again, other = (data[0, seed] for seed in (5, 5, 6))
    for name in ("image", "sparse_depth", "intrinsics", "ground_truth"):
        assert torch.equal(getattr(one, name), getattr(again, name))
        assert not torch.equal(getattr(one, name), getattr(other, name))


def test_a_cache_on_the_device_gives_the_same_samples(folder: Path) -> None:
    settings = AugmentationSettings(sizes=SIZES, least_view=0.6, flip=0.5, density=(0.02, 0.1), noise=0.02)
    device = DeviceCache(torch.device("cpu"), 10**8)
    for one, other in zip(batches(load(folder, settings), 3), batches(load(folder, settings, device), 3), strict=True):
        for name in ("image", "sparse_depth", "input_sparse_depth", "intrinsics", "ground_truth"):
            torch.testing.assert_close(getattr(one, name), getattr(other, name))


def test_the_defaults_leave_all_to_the_model() -> None:
    own = object()
    assert training_transforms(AugmentationSettings(), [own]) == [own]  # type: ignore[list-item]
    assert training_transforms(AugmentationSettings(own=False), [own]) == []  # type: ignore[list-item]
    assert not AugmentationSettings().draws_points


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"density": [0.05, 0.001]}, r"training\.augmentation\.density is \[0\.05, 0\.001\]"),
        ({"density": [0.0, 0.1]}, "density"),
        ({"density": [0.01, 0.02], "patterns": []}, "at least one pattern"),
        ({"density": [0.01, 0.02], "patterns": ["corner"]}, "corners"),
        ({"patterns": ["grid"]}, r"set training\.augmentation\.density"),
        ({"noise": 0.1}, r"set training\.augmentation\.density"),
        ({"least_view": 0.0}, "least_view"),
        ({"sizes": [[64, 0]]}, "sizes"),
        ({"sizes": [64]}, "sizes"),
        ({"flip": 2}, "flip"),
        ({"scale": [1.5, 0.5]}, r"training\.augmentation\.scale is \[1\.5, 0\.5\]"),
        ({"scale": [0.0, 1.0]}, "scale"),
    ],
)
def test_mistakes_are_one_sentence(settings: dict[str, object], message: str) -> None:
    with pytest.raises(DeuxError, match=message) as error:
        construct(AugmentationSettings, settings, "training.augmentation")
    assert "\n" not in str(error.value)
