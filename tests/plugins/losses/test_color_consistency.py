import pytest
import torch

from deux.contracts import LossInputs, LossTerm, Prediction, Reconstructions
from deux.testing.losses import DEPTH_RANGE, LossTermSuite, perfect_sample
from deux_plugins.losses.color_consistency import ColorConsistency


class TestColorConsistency(LossTermSuite):
    def make_term(self) -> LossTerm:
        return ColorConsistency()


class TestBestSource(LossTermSuite):
    def make_term(self) -> LossTerm:
        return ColorConsistency(sources="best")


class TestVoicedConvention(LossTermSuite):
    perfect_is_zero = False

    def make_term(self) -> LossTerm:
        return ColorConsistency(pixels="all", skip_points=True, divisor="image")


PUBLISHED = {
    "kbnet": {"pixels": "all"},
    "fusionnet": {"pixels": "all"},
    "voiced": {"pixels": "all", "skip_points": True, "divisor": "image"},
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_agrees_with_the_published_value(published_case, name):
    inputs, losses = published_case(name)
    value = ColorConsistency(**PUBLISHED[name])(inputs)
    assert float(value) == pytest.approx(losses["color"], rel=1e-4)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, 0.3 + 0.6),
        ({"channels": "mean"}, 0.1 + 0.2),
        ({"pixels": "all"}, (0.3 + 0.9) / 2 + 0.6),
        ({"divisor": "image"}, 0.3 / 2 + 0.6),
        ({"skip_points": True}, 0.3),
        ({"sources": "best"}, 2 * (0.6 + 0.3) / 2),
        ({"sources": "best", "pixels": "all"}, 2 * (0.6 + 0.3) / 2),
    ],
)
def test_which_pixels_count(options, expected):
    """Half of the first frame is invisible and three times as wrong."""
    batch = perfect_sample(1).batch
    images = batch.image[:, None].repeat(1, 2, 1, 1, 1)
    images[:, 0] += 0.1
    images[:, 0, :, :, :16] += 0.2
    images[:, 1] += 0.2
    visible = torch.ones(1, 2, 1, 24, 32, dtype=torch.bool)
    visible[:, 0, :, :, :16] = False
    if options.get("skip_points"):
        images[:, 1] -= 0.2 * (batch.validity[:, 0] == 0)  # only the points' pixels stay wrong, and they do not count
    rebuilt = Reconstructions(images, visible, batch.source_from_target)
    value = ColorConsistency(**options)(LossInputs(batch, Prediction(batch.sparse_depth), rebuilt, DEPTH_RANGE))
    assert float(value) == pytest.approx(expected, rel=1e-4)
