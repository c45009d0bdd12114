"""The built-in simulator against what Habitat-Sim rendered and knows of small_house, and against its step semantics."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from deux.contracts import Robot, Scene
from deux.geometry.grid import FreeSpace
from deux.scenes.free_space import free_space
from deux.simulator.body import Body

STEP = 0.25


class Navmesh:
    """Habitat-Sim's navmesh in the plane, and a step on it as Detour's `moveAlongSurface` takes it.

    Detour visits the polygons around the start that are joined by edges within half a step of the step's middle; the
    step ends at its target, if one of them contains it, or at the nearest point of their walls.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        corners = vertices[triangles]
        _, number = np.unique(np.round(corners.reshape(-1, 3), 3), axis=0, return_inverse=True)
        edges: dict[frozenset[int], list[tuple[int, int]]] = {}
        for triangle, ids in enumerate(number.reshape(-1, 3).tolist()):
            for edge in range(3):
                edges.setdefault(frozenset((ids[edge], ids[(edge + 1) % 3])), []).append((triangle, edge))
        self.corners = corners[..., [0, 2]].astype(np.float64)
        self.beyond = np.full((len(triangles), 3), -1)
        for sides in edges.values():
            if len(sides) == 2:
                (one, one_edge), (other, other_edge) = sides
                self.beyond[one, one_edge], self.beyond[other, other_edge] = other, one
        self.island = self._reachable(int(np.argmax(self._areas())))

    def _areas(self) -> np.ndarray:
        first, second = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        return 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])

    def _reachable(self, triangle: int) -> list[int]:
        found, waiting = {triangle}, [triangle]
        while waiting:
            for other in self.beyond[waiting.pop()].tolist():
                if other >= 0 and other not in found:
                    found.add(other)
                    waiting.append(other)
        return sorted(found)

    def containing(self, point: np.ndarray) -> int | None:
        """The triangle of the largest island in which a point lies."""
        for triangle in self.island:
            if self._contains(triangle, point):
                return triangle
        return None

    def _contains(self, triangle: int, point: np.ndarray) -> bool:
        edge = np.roll(self.corners[triangle], -1, axis=0) - self.corners[triangle]
        to = point - self.corners[triangle]
        side = edge[:, 0] * to[:, 1] - edge[:, 1] * to[:, 0]
        return bool((side >= -1e-12).all() or (side <= 1e-12).all())

    def step(self, triangle: int, start: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Where a step from `start`, in `triangle`, to `target` ends."""
        middle, radius = (start + target) / 2.0, float(np.linalg.norm(target - start)) / 2.0 + 0.001
        nearest, best = start, math.inf
        seen, waiting = {triangle}, [triangle]
        while waiting:
            here = waiting.pop(0)
            if self._contains(here, target):
                return target
            for edge in range(3):
                ends = self.corners[here, edge], self.corners[here, (edge + 1) % 3]
                other = int(self.beyond[here, edge])
                if other < 0:
                    point = on_segment(target, *ends)
                    if np.linalg.norm(point - target) < best:
                        nearest, best = point, float(np.linalg.norm(point - target))
                elif other not in seen and np.linalg.norm(on_segment(middle, *ends) - middle) <= radius:
                    seen.add(other)
                    waiting.append(other)
        return nearest


def on_segment(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The point of a segment that is nearest to `point`."""
    along = end - start
    return start + np.clip((point - start) @ along / (along @ along), 0.0, 1.0) * along


@pytest.fixture(scope="module")
def navmesh(shared_data: Callable[[str], Path]) -> Navmesh:
    with np.load(shared_data("habitat") / "topdown_5cm.npz") as data:
        return Navmesh(data["navmesh_vertices"].astype(np.float64), data["navmesh_triangles"])


@pytest.fixture(scope="module")
def house_floor(small_house: Scene) -> FreeSpace:
    return free_space(small_house.mesh, small_house.floors[0].height, Robot())
