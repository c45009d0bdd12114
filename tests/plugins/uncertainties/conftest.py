"""Views of an analytic scene: a textured wall that faces the camera, seen by it and by two cameras before it."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from deux.contracts import DepthPredictor, View

HEIGHT, WIDTH, FOCAL, WALL = 48, 64, 40.0, 2.0
INTRINSICS = torch.tensor([[FOCAL, 0.0, (WIDTH - 1) / 2], [0.0, FOCAL, (HEIGHT - 1) / 2], [0.0, 0.0, 1.0]])

MakeView = Callable[..., View]


def _wall(x: Tensor, y: Tensor) -> Tensor:
    """Colours 3 x ... of the wall at metres x, y: smooth, so that bilinear sampling hardly errs."""
    waves = [torch.sin(5.0 * x + phase) * torch.cos(4.0 * y + phase) for phase in (0.0, 1.0, 2.0)]
    return 0.5 + 0.25 * torch.stack(waves)


def _picture(position: Tensor, turn: float) -> Tensor:
    """What a camera at a position in metres, turned about the vertical axis, sees of the wall: 3 x H x W."""
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


@pytest.fixture
def make_view() -> MakeView:
    """Makes a view of the wall, whose depth is 2 m everywhere."""

    def make(
        depth: Tensor | None = None,
        moves: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, -0.25), (0.1, 0.0, -0.4)),
        turn: float = 0.0,
        points: Tensor | None = None,
        predict_depth: DepthPredictor | None = None,
    ) -> View:
        """A view.

        Args:
            depth: N x 1 x H x W, predicted; None for the true one.
            moves: where the source cameras stood, metres.
            turn: by how many radians they were turned.
            points: N x 1 x H x W bool, where the sparse points are.
            predict_depth: the depth model.
        """
        true = torch.full((1, 1, HEIGHT, WIDTH), WALL)
        depth = true if depth is None else depth
        n = len(depth)
        source_from_target = torch.eye(4).repeat(1, len(moves), 1, 1)
        for i, move in enumerate(moves):
            source_from_target[0, i, :3, :3] = _rotation(turn).T
            source_from_target[0, i, :3, 3] = -_rotation(turn).T @ torch.tensor(move)
        return View(
            image=_picture(torch.zeros(3), 0.0)[None].repeat(n, 1, 1, 1),
            sparse_depth=torch.where(points, true, 0.0) if points is not None else torch.zeros_like(depth),
            intrinsics=INTRINSICS.repeat(n, 1, 1),
            depth=depth,
            sources=torch.stack([_picture(torch.tensor(move), turn) for move in moves])[None].repeat(n, 1, 1, 1, 1),
            source_from_target=source_from_target.repeat(n, 1, 1, 1),
            predict_depth=predict_depth or (lambda image, sparse_depth, intrinsics: depth),
        )

    return make
