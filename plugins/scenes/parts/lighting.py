"""Baked lighting in vertex colours, which depends on position and orientation of surfaces but not on the camera."""

from dataclasses import dataclass

import numpy as np

AMBIENT, LAMP, SIDE = 0.66, 0.44, 0.04
"""Fractions of ambient light, of light from the room's lamp, and of light from one side of the building."""

CORNER_DEPTH, CORNER_LOSS = 0.5, 0.16
"""Ambient occlusion: distance in metres from edges between wall, floor and ceiling, and greatest loss of light."""


@dataclass(frozen=True)
class Light:
    """The lamp of one room.

    Args:
        room: (x0, z0, x1, z1) of the inside of the room, metres.
        height: height of its ceiling, metres.
        color: factors of red, green and blue, about 1.
    """

    room: tuple[float, float, float, float]
    height: float
    color: tuple[float, float, float]


def shade(corners: np.ndarray, lights: list[Light]) -> np.ndarray:
    """The vertex colours, N x 4 x 3 uint8, of N x 4 x 3 corners of quadrilaterals, lit by the lamp of their room.

    Args:
        corners: N x 4 x 3 float64, metres.
        lights: the lamps of all rooms.
    """
    diagonal = corners[:, 2] - corners[:, 0]
    other = corners[:, 3] - corners[:, 1]
    normals = _cross(diagonal, other)
    normals /= np.sqrt(_dot(normals, normals))[:, None]
    normals = np.broadcast_to(normals[:, None], corners.shape)
    rooms = np.array([light.room for light in lights])
    heights = np.array([light.height for light in lights])
    centre = corners.mean(axis=1)
    outside = np.maximum(rooms[:, :2] - centre[:, None, [0, 2]], centre[:, None, [0, 2]] - rooms[:, 2:])
    index = np.argmin(np.maximum(outside, 0.0).max(axis=2), axis=1)
    room, height = rooms[index][:, None], heights[index][:, None]
    lamp = np.stack([(room[..., 0] + room[..., 2]) / 2, height - 0.4, (room[..., 1] + room[..., 3]) / 2], axis=-1)
    ray = lamp - corners
    squared = _dot(ray, ray)
    facing = np.maximum(_dot(ray, normals) / np.sqrt(squared + 1e-6), 0.0)
    light = AMBIENT + LAMP * (0.3 + 0.7 * facing) / (1.0 + squared * 0.06)
    light += SIDE * normals[..., 0] + 0.5 * SIDE * normals[..., 2]
    light *= 1.0 - CORNER_LOSS * _corner(corners, normals, room, height)
    colors = np.array([light.color for light in lights])[index][:, None]
    return np.clip(np.floor(light[..., None] * colors * 255.0 + 0.5), 0, 255).astype(np.uint8)


def _corner(corners: np.ndarray, normals: np.ndarray, room: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Ambient occlusion in [0, 1]: by the height of points on vertical faces, by the nearest wall on level faces."""
    x, y, z = corners[..., 0], corners[..., 1], corners[..., 2]
    to_wall = np.minimum(np.minimum(x - room[..., 0], room[..., 2] - x), np.minimum(z - room[..., 1], room[..., 3] - z))
    to_edge = np.minimum(y, height - y)
    level = np.abs(normals[..., 1])
    distance = level * np.maximum(to_wall, 0.0) + (1.0 - level) * to_edge
    return np.clip(1.0 - distance / CORNER_DEPTH, 0.0, 1.0)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot product over the last axis of three, with a fixed order of the sum for exact results."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
