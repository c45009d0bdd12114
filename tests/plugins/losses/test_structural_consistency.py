import pytest
import torch
from kornia.metrics import ssim

from deux.contracts import LossInputs, LossTerm, Prediction, Reconstructions
from deux.errors import DeuxError
from deux.testing.losses import DEPTH_RANGE, LossTermSuite, perfect_sample
from deux_plugins.losses.structural_consistency import StructuralConsistency

PUBLISHED = {"halved": True, "channels": "sum", "window": "box", "pixels": "all"}


class TestStructuralConsistency(LossTermSuite):
    def make_term(self) -> LossTerm:
        return StructuralConsistency()


class TestBestSource(LossTermSuite):
    def make_term(self) -> LossTerm:
        return StructuralConsistency(sources="best")


class TestKBNetConvention(LossTermSuite):
    perfect_is_zero = False

    def make_term(self) -> LossTerm:
        return StructuralConsistency(**PUBLISHED, border="stretch")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("kbnet", {"border": "stretch"}),
        ("fusionnet", {}),
        ("voiced", {"skip_points": True, "divisor": "image"}),
    ],
)
def test_agrees_with_the_published_value(published_case, name, options):
    inputs, losses = published_case(name)
    value = StructuralConsistency(**PUBLISHED, **options)(inputs)
    assert float(value) == pytest.approx(losses["structure"], rel=1e-4)


def test_default_is_one_minus_ssim_summed_over_the_frames(published_case):
    inputs, _ = published_case("kbnet")
    value = StructuralConsistency()(inputs)
    image, rebuilt = inputs.batch.image, inputs.reconstructions.images
    expected = sum(1.0 - ssim(image, rebuilt[:, s], window_size=3).mean() for s in (0, 1))
    assert float(value) == pytest.approx(float(expected), rel=1e-4)


def test_what_the_source_frame_does_not_see_has_no_influence():
    batch = perfect_sample(1).batch
    images = batch.image[:, None].repeat(1, 2, 1, 1, 1)
    visible = torch.ones(1, 2, 1, 24, 32, dtype=torch.bool)
    visible[..., :10, :7] = False
    images[..., :10, :7] = torch.rand(10, 7, generator=torch.Generator().manual_seed(0))
    rebuilt = Reconstructions(images, visible, batch.source_from_target)
    value = StructuralConsistency()(LossInputs(batch, Prediction(batch.sparse_depth), rebuilt, DEPTH_RANGE))
    assert float(value) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("size", [4, 2, 0, -3])
def test_a_window_without_a_centre_is_refused(size):
    with pytest.raises(DeuxError, match=rf"structural_consistency\.window_size is {size}: it must be an odd number of"):
        StructuralConsistency(window_size=size)


@pytest.mark.parametrize("size", [1, 5])
def test_windows_with_a_centre_are_taken(size):
    """A perfect reconstruction costs nothing."""
    batch = perfect_sample(1).batch
    images = batch.image[:, None].repeat(1, 2, 1, 1, 1)
    visible = torch.ones(1, 2, 1, *images.shape[-2:], dtype=torch.bool)
    rebuilt = Reconstructions(images, visible, batch.source_from_target)
    inputs = LossInputs(batch, Prediction(batch.sparse_depth), rebuilt, DEPTH_RANGE)
    assert float(StructuralConsistency(window_size=size)(inputs)) == pytest.approx(0.0, abs=1e-5)
