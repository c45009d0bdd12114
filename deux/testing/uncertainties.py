"""Conformance suite for measures of uncertainty: tests of the contract of `deux.contracts.Uncertainty`.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMyMeasure(UncertaintySuite):
        def make_uncertainty(self) -> Uncertainty:
            return MyMeasure()

The views show a textured wall parallel to the image plane at a distance of `WALL` metres (`wall_view`). Images are
exact, so that a perfect prediction has almost no photometric error.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from deux.contracts import DepthPredictor, Uncertainty, View
from deux.errors import kind_of
from deux.frame_uncertainty import frame_of, make_view
from deux.testing.host_waits import refuse_host_waits

HEIGHT, WIDTH = 48, 64
FOCAL = 40.0
WALL = 2.0
"""Distance from the camera to the wall in metres."""

INTRINSICS = torch.tensor([[FOCAL, 0.0, (WIDTH - 1) / 2], [0.0, FOCAL, (HEIGHT - 1) / 2], [0.0, 0.0, 1.0]])

MOVES = ((0.0, 0.0, -0.25), (0.1, 0.0, -0.4))
"""Positions of the source cameras relative to the target camera in metres: behind it, as for a forward motion."""


def wall_view(
    depth: Tensor | None = None,
    moves: Sequence[tuple[float, float, float]] = MOVES,
    turn: float = 0.0,
    points: Tensor | None = None,
    predict_depth: DepthPredictor | None = None,
) -> View:
    """Create a view of the wall.

    Args:
        depth: N x 1 x H x W predicted depth in metres; None for the true depth with N = 1.
        moves: positions of the source cameras in metres along the axes of the target camera.
        turn: rotation of the source cameras about the vertical axis in radians.
        points: N x 1 x H x W or 1 x 1 x H x W bool, pixels with sparse points of true depth; None for no points.
        predict_depth: depth model that the measure can call; does not affect `depth`. None for a model that always
            predicts the depth of the first frame.
    """
    true = torch.full((1, 1, HEIGHT, WIDTH), WALL)
    predicted = true if depth is None else depth
    count = len(predicted)
    source_from_target = torch.eye(4).repeat(count, len(moves), 1, 1)
    for i, move in enumerate(moves):
        source_from_target[:, i, :3, :3] = _rotation(turn).T
        source_from_target[:, i, :3, 3] = -_rotation(turn).T @ torch.tensor(move)
    view = make_view(
        image=_picture(torch.zeros(3), 0.0).repeat(count, 1, 1, 1),
        sparse_depth=torch.zeros_like(predicted) if points is None else WALL * points.expand_as(predicted),
        intrinsics=INTRINSICS.repeat(count, 1, 1),
        sources=torch.stack([_picture(torch.tensor(move), turn) for move in moves]).repeat(count, 1, 1, 1, 1),
        source_from_target=source_from_target,
        predict_depth=lambda image, sparse_depth, intrinsics: predicted,
    )
    again = predict_depth or (lambda image, sparse_depth, intrinsics: predicted[:1].repeat(len(image), 1, 1, 1))
    return replace(view, predict_depth=again)


def point_grid(spacing: int = 8) -> Tensor:
    """Create a mask of sparse points on a grid, 1 x 1 x H x W bool.

    Args:
        spacing: distance between points in pixels.
    """
    points = torch.zeros(1, 1, HEIGHT, WIDTH, dtype=torch.bool)
    points[..., spacing // 2 :: spacing, spacing // 2 :: spacing] = True
    return points


def _wall(x: Tensor, y: Tensor) -> Tensor:
    """Colours of the wall at positions x, y in metres, 3 x ...; smooth, so that bilinear sampling is accurate."""
    waves = [torch.sin(5.0 * x + phase) * torch.cos(4.0 * y + phase) for phase in (0.0, 1.0, 2.0)]
    return 0.5 + 0.25 * torch.stack(waves)


def _picture(position: Tensor, turn: float) -> Tensor:
    """Render the wall for a camera at a position in metres, rotated about the vertical axis: 3 x H x W."""
    v, u = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    rays = torch.stack(
        [(u - INTRINSICS[0, 2]) / FOCAL, (v - INTRINSICS[1, 2]) / FOCAL, torch.ones_like(u, dtype=torch.float32)]
    )
    rays = torch.einsum("ij,jhw->ihw", _rotation(turn), rays)
    points = position[:, None, None] + rays * ((WALL - position[2]) / rays[2])
    return _wall(points[0], points[1])


def _rotation(turn: float) -> Tensor:
    angle = torch.tensor(turn)
    c, s = angle.cos(), angle.sin()
    return torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


class CheckedPredictor:
    """A depth model that checks its inputs; predicts larger depth for darker pixels, at least 2 m.

    Args:
        device: expected device of the inputs; None for the CPU.
    """

    def __init__(self, device: torch.device | None = None) -> None:
        self.device = device or torch.device("cpu")

    def __call__(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        """Return N x 1 x H x W depth in metres."""
        count = len(image)
        assert image.shape == (count, 3, HEIGHT, WIDTH), f"predict_depth got an image of shape {tuple(image.shape)}"
        assert sparse_depth.shape == (count, 1, HEIGHT, WIDTH), "one channel of sparse depth, as large as the image"
        assert intrinsics.shape == (count, 3, 3), "predict_depth takes one camera matrix for each image"
        for name, value in (("image", image), ("sparse_depth", sparse_depth), ("intrinsics", intrinsics)):
            assert value.dtype == torch.float32, f"predict_depth got {name} as {value.dtype}"
            assert value.device.type == self.device.type, f"predict_depth got {name} on {value.device}"
            assert value.isfinite().all(), f"predict_depth got {name} that is not finite"
        assert 0.0 <= image.min() <= image.max() <= 1.0, "predict_depth takes images in [0, 1]"
        assert sparse_depth.min() >= 0.0, "predict_depth takes sparse depth in metres, 0 = none"
        assert (intrinsics[:, 0, 0] > 0).all(), "predict_depth takes focal lengths above 0"
        nearby = sparse_depth.sum((1, 2, 3), keepdim=True) / HEIGHT / WIDTH
        return 3.0 - image.mean(1, keepdim=True) + nearby


class UncertaintySuite:
    """Base class of the tests of a measure of uncertainty. Subclasses define `make_uncertainty`.

    Set `computes_on_host` to True for a measure that uses a library without GPU support, such as scipy.
    """

    computes_on_host: ClassVar[bool] = False

    @abstractmethod
    def make_uncertainty(self) -> Uncertainty:
        """Create the measure to test."""

    def measure(self, view: View) -> Tensor:
        """Compute the uncertainty of a view with a new measure, and check shape, dtype, device and range of values."""
        with torch.inference_mode():
            uncertainty = self.make_uncertainty()(view)
        assert isinstance(uncertainty, Tensor), f"not a Tensor: {kind_of(uncertainty)}"
        assert uncertainty.shape == view.depth[:, 0].shape, f"not N x H x W: {tuple(uncertainty.shape)}"
        assert uncertainty.dtype == torch.float32, f"not float32: {uncertainty.dtype}"
        assert uncertainty.device == view.depth.device, f"not on the view's device: {uncertainty.device}"
        assert not uncertainty.isinf().any(), "an uncertainty is finite, or NaN where the measure has no value"
        assert not (uncertainty < 0.0).any(), "an uncertainty is not negative"
        return uncertainty

    def test_has_values_in_a_view_with_all_inputs(self) -> None:
        """Some pixels have a value for views with motion, texture, sparse points and wrong depth."""
        assert self.measure(_views()).isfinite().any(), "no pixel has a value, although all inputs are given"

    def test_same_view_same_values(self) -> None:
        """The measure is deterministic and does not depend on previous calls."""
        measure, view = self.make_uncertainty(), _views()
        with torch.inference_mode():
            first = measure(view)
            measure(wall_view(points=point_grid(4), predict_depth=CheckedPredictor()))
            second = measure(view)
        assert torch.equal(first.nan_to_num(-1.0), second.nan_to_num(-1.0)), "the same view has other values"

    def test_frames_of_a_batch_do_not_touch_each_other(self) -> None:
        """The values of a frame do not depend on the other frames of the batch."""
        view = _views()
        batched = self.measure(view)
        for i in range(len(view.image)):
            alone = self.measure(frame_of(view, i))
            torch.testing.assert_close(
                batched[i], alone[0], rtol=1e-4, atol=1e-5, equal_nan=True, msg=f"frame {i} depends on the batch"
            )

    def test_leaves_the_view_alone(self) -> None:
        """The measure does not write to the tensors of a view, which are shared."""
        view = _views()
        before = {name: value.clone() for name, value in _tensors(view).items()}
        self.measure(view)
        for name, value in _tensors(view).items():
            assert torch.equal(value, before[name]), f"the measure changed {name}"

    def test_survives_points_that_nothing_shows(self) -> None:
        """Views without sparse points, without visible pixels and without both are supported; values may be NaN."""
        seen = wall_view(torch.full((1, 1, HEIGHT, WIDTH), 2.2), predict_depth=CheckedPredictor())
        away = torch.zeros_like(seen.visible)
        for view in (
            seen,
            replace(seen, visible=away),
            replace(seen, visible=away, sparse_depth=torch.where(point_grid(), WALL, 0.0)),
        ):
            self.measure(view)

    def test_survives_a_camera_that_only_turned(self) -> None:
        """Views without parallax are supported."""
        standing = ((0.0, 0.0, 0.0),) * 2
        self.measure(wall_view(moves=standing, turn=0.17, points=point_grid(), predict_depth=CheckedPredictor()))

    def test_survives_an_image_of_one_colour(self) -> None:
        """Views without texture in target and source frames are supported."""
        view = _views()
        grey = {name: torch.full_like(getattr(view, name), 0.5) for name in ("image", "sources", "rebuilt")}
        self.measure(replace(view, **grey))  # type: ignore[arg-type]

    def test_takes_any_number_of_source_frames(self) -> None:
        """Views with one and with four source frames are supported."""
        for moves in (MOVES[:1], MOVES * 2):
            self.measure(wall_view(moves=moves, points=point_grid(), predict_depth=CheckedPredictor()))

    def test_works_without_source_frames_if_it_needs_none(self) -> None:
        """If `needs_sources` is False, the values are the same without source frames."""
        if self.make_uncertainty().needs_sources:
            pytest.skip("the measure compares a frame with its source frames")
        view = _views()
        none = {name: getattr(view, name)[:, :0] for name in ("sources", "source_from_target", "rebuilt", "visible")}
        torch.testing.assert_close(self.measure(replace(view, **none)), self.measure(view), equal_nan=True)

    def test_keeps_a_card_busy(self) -> None:
        """The measure does not synchronize with the GPU, except that the first call may."""
        if self.computes_on_host:
            pytest.skip("the measure declares that it computes on the host")
        measure = self.make_uncertainty()
        view = replace(_views(), predict_depth=lambda image, points, cameras: 2.0 + 0.1 * image[:, :1])
        with torch.inference_mode():
            measure(view)
            with refuse_host_waits():
                measure(view)

    def test_stays_on_a_graphics_card(self) -> None:
        """On a GPU, the result is on the device of the view and agrees with that of the CPU; skipped without a GPU."""
        if not torch.cuda.is_available():
            pytest.skip("needs a GPU")
        card = torch.device("cuda")
        view = _views()
        moved = {name: value.to(card) for name, value in _tensors(view).items()}
        there = self.measure(replace(view, predict_depth=CheckedPredictor(card), **moved))
        torch.testing.assert_close(there.cpu(), self.measure(view), rtol=1e-2, atol=1e-3, equal_nan=True)


def _views() -> View:
    """Create a view of three frames with different predictions and sparse points; one has no points."""
    column = torch.linspace(-0.3, 0.3, WIDTH).expand(1, 1, HEIGHT, WIDTH)
    depth = torch.cat([torch.full_like(column, 1.9), WALL + column, torch.full_like(column, 2.2)])
    points = torch.cat([point_grid(8), point_grid(5), torch.zeros_like(point_grid())])
    return wall_view(depth, points=points, predict_depth=CheckedPredictor())


def _tensors(view: View) -> dict[str, Tensor]:
    """All tensors of a view, by name."""
    parts = {field.name: getattr(view, field.name) for field in fields(view)}
    return {name: part for name, part in parts.items() if isinstance(part, Tensor)}
