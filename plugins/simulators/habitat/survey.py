"""The height of the ground, and what is covered, measured with Habitat-Sim's depth sensor from far away.

The navmesh lies up to one cell height above what it was made from, and most builds of Habitat-Sim cannot cast rays.
A depth image can: its near plane takes away all that is above the robot, so that a camera far above the building sees
the ground. From so far its rays are as good as parallel, and each pixel is one cell of the grid.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame

if TYPE_CHECKING:
    from deux_plugins.simulators.habitat.session import Session

DISTANCE = 50.0  # of the camera, in halves of the grid's longer side: a ray leans by a fiftieth at most
DEEP = 3.0  # metres below a level within which its ground is sought
HIGH = 20.0  # metres above a level within which its ceiling is sought


def ground(session: Session, frame: GridFrame, level: float, headroom: float) -> np.ndarray:
    """The surface that is seen from above at each cell, looking through all that is higher than a level's headroom.

    Args:
        session: the scene.
        frame: the grid.
        level: world y of the level, metres.
        headroom: metres above `level` from which surfaces are looked through.

    Returns:
        rows x columns float32: world y of the surface at the cell's centre, NaN where there is none.
    """
    camera, distance = _camera(frame)
    pose = _pose(frame, level + distance, down=True)
    depth = session.depth(pose, camera, distance - headroom, distance + DEEP)
    return np.where(depth > 0.0, level + distance - depth, np.nan).astype(np.float32)


def covered(session: Session, frame: GridFrame, level: float, headroom: float) -> np.ndarray:
    """Whether a ceiling is above each cell of a level: rows x columns bool; arguments as of `ground`."""
    camera, distance = _camera(frame)
    pose = _pose(frame, level - distance, down=False)
    return session.depth(pose, camera, distance + headroom, distance + HIGH)[::-1] > 0.0


def _camera(frame: GridFrame) -> tuple[Camera, float]:
    """A camera of one pixel for each cell, and its distance from the level in metres."""
    distance = DISTANCE / 2.0 * frame.resolution * max(frame.rows, frame.columns)
    hfov = 2.0 * math.atan(frame.columns * frame.resolution / 2.0 / distance)
    return Camera(frame.columns, frame.rows, math.degrees(hfov)), distance


def _pose(frame: GridFrame, y: float, down: bool) -> np.ndarray:
    """A camera over or under the grid's middle; its columns run along x and, looking down, its rows along z."""
    x, z = frame.centre((frame.rows - 1) / 2.0, (frame.columns - 1) / 2.0)
    sign = 1.0 if down else -1.0
    return np.array([[1.0, 0.0, 0.0, x], [0.0, 0.0, -sign, y], [0.0, sign, 0.0, z], [0.0, 0.0, 0.0, 1.0]])
