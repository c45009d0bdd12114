"""Figures of scenes: a plan from above without the ceiling, and two interior views."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from deux.contracts import COLOR, Frame, Robot, Scene, SceneReference, Simulator
from deux.figures.drawing import hide_ticks, new_figure
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.scenes.loaded_scene import loaded_scene
from deux.scenes.ray_caster import RayCaster
from deux.simulator.mesh_simulator import MeshSimulator
from deux.simulator.shading import prepare_surfaces, shade
from deux.simulator.starts import random_starts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CUT = 1.9  # cutting height above the floor in metres: below lintels, above most furniture
CLEAR = 1.2  # minimum median depth of a view in metres, which excludes close-ups of furniture
_MARGIN = 0.3


MOST_PIXELS = 4_000_000
"""Maximum size of a plan, 2,500 square metres at the default scale; rendering needs 125 bytes per pixel."""


def plan_from_above(scene: Scene, cut: float = CUT, pixels_per_metre: float = 40.0) -> np.ndarray:
    """Render the main floor of a scene from above in parallel projection, without anything above the cut.

    Args:
        scene: the scene.
        cut: cutting height above the floor, metres.
        pixels_per_metre: maximum scale; it is reduced for images of more than `MOST_PIXELS`.

    Returns:
        rows x columns x 3 uint8, x to the right and z downward; dark where there is no surface.
    """
    mesh = scene.mesh
    low, high = mesh.bounds[:, [0, 2]].astype(np.float64) + np.array([[-_MARGIN], [_MARGIN]])
    pixels_per_metre = min(pixels_per_metre, math.sqrt(MOST_PIXELS / float(np.prod(high - low))))
    columns, rows = np.ceil((high - low) * pixels_per_metre).astype(int)
    pixel = 1.0 / pixels_per_metre
    x, z = np.meshgrid(low[0] + (np.arange(columns) + 0.5) * pixel, low[1] + (np.arange(rows) + 0.5) * pixel)
    top = np.full(x.size, scene.floor_height - mesh.origin[1] + cut)
    rays = np.broadcast_to(np.array([0.0, -1.0, 0.0], np.float32), (x.size, 3))
    hits = RayCaster(mesh).cast(np.stack([x.ravel(), top, z.ravel()], axis=-1), rays)
    # With parallel rays, the size of a pixel does not depend on the depth, which is set to one metre.
    right, down = np.array([pixel, 0.0, 0.0], np.float32), np.array([0.0, 0.0, pixel], np.float32)
    depth = np.ones(x.size, np.float32)
    colors = shade(hits.face, hits.barycentric, depth, np.ascontiguousarray(rays), right, down, prepare_surfaces(mesh))
    colors[hits.face < 0] = (28, 28, 34)
    return colors.reshape(rows, columns, 3)


def plainest_and_richest(simulator: Simulator, candidates: int = 60, seed: int = 0) -> tuple[Frame, Frame]:
    """Find the views with the least and the most texture among random views of the main floor.

    Args:
        simulator: simulator of the scene.
        candidates: number of random views, which are compared by `texture_contrast`.
        seed: random seed of the views.
    """
    space, eye = simulator.free_space(0), simulator.robot.camera_height
    places = random_starts(space, candidates, np.random.default_rng(seed))
    poses = np.stack([camera_pose(x, space.height_at(x, z) + eye, z, yaw) for x, z, yaw in places])
    frames = simulator.render(poses, COLOR)
    by_texture = sorted(
        [frame for frame in frames if np.median(frame.depth) > CLEAR] or frames,
        key=lambda frame: texture_contrast(frame.rgb),
    )
    return by_texture[0], by_texture[-1]


def texture_contrast(image: np.ndarray) -> float:
    """Mean absolute difference of neighbouring pixels of an image (H x W x 3 uint8), in grey levels."""
    gray = image.astype(np.float64).mean(axis=-1)
    return float((np.abs(np.diff(gray, axis=0)).mean() + np.abs(np.diff(gray, axis=1)).mean()) / 2)


def draw_scene(scene: SceneReference, camera: Camera | None = None, robot: Robot | None = None) -> Figure:
    """Draw the main floor of a scene from above, and its views with the least and the most texture.

    Args:
        scene: the scene.
        camera: camera of the views; 384 x 384 pixels and 90 degrees by default.
        robot: robot that defines the camera height.
    """
    loaded = loaded_scene(scene)
    views = plainest_and_richest(MeshSimulator(scene, camera or Camera(384, 384), robot or Robot()))
    plan = plan_from_above(loaded)
    figure = new_figure(11.0, 5.0)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.9, 1.0))
    panels = [figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])]
    for panel, image in zip(panels, (plan, *(view.rgb for view in views)), strict=True):
        panel.imshow(image)
        hide_ticks(panel)
    panels[0].set_title(f"{scene.name}: {loaded.floors[0].area:.0f} m²", fontsize=10)
    return figure
