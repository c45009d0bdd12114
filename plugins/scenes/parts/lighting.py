"""Light baked into vertex colours: it depends on where a surface is and how it is turned, never on the camera."""

from dataclasses import dataclass

import numpy as np

AMBIENT, LAMP, SIDE = 0.66, 0.44, 0.04
"""Shares of the light that comes from everywhere, from the room's lamp, and from one side of the building."""

CORNER_DEPTH, CORNER_LOSS = 0.5, 0.16
"""Within this many metres of a corner between wall, floor and ceiling, up to this fraction of the light is lost."""


@dataclass(frozen=True)
class Light:
    """The lamp of one room.

    Args:
        room: (x0, z0, x1, z1) of the room's inside, metres.
        height: height of its ceiling, metres.
        color: what the lamp does to red, green and blue, about 1.
    """

    room: tuple[float, float, float, float]
    height: float
    color: tuple[float, float, float]


def shade(corners: np.ndarray, lights: list[Light]) -> np.ndarray:
    """Colour of every corner of quadrilaterals (N x 4 x 3, metres, float64) under the lamp of its room, uint8."""
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
    """How deep in a corner a point is, 0 to 1: by its height on upright faces, by the nearest wall on level ones."""
    x, y, z = corners[..., 0], corners[..., 1], corners[..., 2]
    to_wall = np.minimum(np.minimum(x - room[..., 0], room[..., 2] - x), np.minimum(z - room[..., 1], room[..., 3] - z))
    to_edge = np.minimum(y, height - y)
    level = np.abs(normals[..., 1])
    distance = level * np.maximum(to_wall, 0.0) + (1.0 - level) * to_edge
    return np.clip(1.0 - distance / CORNER_DEPTH, 0.0, 1.0)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sum of products over the last axis of three, in a fixed order (a library's sum may use another)."""
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
