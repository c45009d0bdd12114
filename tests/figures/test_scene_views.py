"""Pictures of a world whose colours and places are known."""

import numpy as np
import pytest

from deux.contracts import Floor, Material, Robot, Scene, SceneMesh
from deux.figures import scene_views
from deux.figures.scene_views import draw_scene, plainest_and_richest, plan_from_above, texture_contrast
from deux.geometry.camera import Camera
from deux.simulator.mesh_simulator import MeshSimulator

RED, GREEN, CHECKS = 0, 1, 2


def quad(corners: list[tuple[float, float, float]]) -> list[list[tuple[float, float, float]]]:
    a, b, c, d = corners
    return [[a, b, c], [a, c, d]]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A room of 4 m x 6 m: green, a red table top of 1 m x 2 m at 0.7 m, a red ceiling, a checked wall in the north."""
    level = lambda x0, z0, x1, z1, y: quad([(x0, y, z1), (x1, y, z1), (x1, y, z0), (x0, y, z0)])  # noqa: E731
    upright = lambda x0, z0, x1, z1: quad([(x0, 0.0, z0), (x1, 0.0, z1), (x1, 2.5, z1), (x0, 2.5, z0)])  # noqa: E731
    parts = [
        (level(0.0, 0.0, 4.0, 6.0, 0.0), GREEN),
        (level(1.0, 1.0, 2.0, 3.0, 0.7), RED),
        (level(0.0, 0.0, 4.0, 6.0, 2.5), RED),
        (upright(0.0, 0.0, 4.0, 0.0), CHECKS),
        (upright(4.0, 0.0, 4.0, 6.0), GREEN),
        (upright(4.0, 6.0, 0.0, 6.0), GREEN),
        (upright(0.0, 6.0, 0.0, 0.0), GREEN),
    ]
    triangles = np.array([triangle for pair, _ in parts for triangle in pair], np.float32)
    material = np.repeat([kind for _, kind in parts], 2).astype(np.int32)
    checks = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.ones((4, 4)))[..., None].repeat(3, axis=2) * 255
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], np.float32), np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    mesh = SceneMesh(
        vertices=triangles.reshape(-1, 3),
        faces=np.arange(len(triangles) * 3, dtype=np.int32).reshape(-1, 3),
        uv=np.array([unit[index % 2] for index in range(len(triangles))], np.float32),
        face_material=material,
        materials=(
            Material("red", (200, 0, 0)),
            Material("green", (0, 150, 0)),
            Material("checks", texture=checks.astype(np.uint8)),
        ),
        face_label=np.full(len(triangles), -1, np.int32),
    )
    return Scene("room", mesh, (Floor(0.0, 24.0),), "room")


def test_the_plan_shows_furniture_where_it_stands_and_no_ceiling(scene: Scene):
    plan = plan_from_above(scene, pixels_per_metre=20.0)
    assert plan.shape == (132, 92, 3)  # 0.3 m of margin on each side

    def at(x: float, z: float) -> list[int]:
        return plan[int((z + 0.3) * 20), int((x + 0.3) * 20)].tolist()

    assert at(1.5, 2.0) == at(1.1, 2.9) == [200, 0, 0]
    assert at(0.5, 2.0) == at(1.5, 3.5) == at(3.5, 5.5) == [0, 150, 0]
    assert at(-0.2, 3.0) == at(2.0, 6.2) != [0, 150, 0]


def test_a_large_scene_is_drawn_smaller(scene: Scene, monkeypatch):
    monkeypatch.setattr(scene_views, "MOST_PIXELS", 2000)
    plan = plan_from_above(scene, pixels_per_metre=20.0)
    assert 1800 < plan.shape[0] * plan.shape[1] < 2200
    assert plan.shape[0] / plan.shape[1] == pytest.approx(132 / 92, rel=0.1)


def test_a_lower_cut_cuts_the_table_off(scene: Scene):
    assert not (plan_from_above(scene, cut=0.5) == (200, 0, 0)).all(axis=-1).any()


def test_contrast_of_stripes_and_of_nothing():
    stripes = np.tile(np.array([0, 100], np.uint8), (8, 4))[..., None].repeat(3, axis=2)
    assert texture_contrast(stripes) == pytest.approx(50.0)  # every step along a row, none along a column
    assert texture_contrast(np.full((8, 8, 3), 7, np.uint8)) == 0.0


def test_the_richest_view_looks_at_the_checks(scene: Scene):
    plain, rich = plainest_and_richest(MeshSimulator(scene, Camera(64, 64), Robot()))
    assert (plain.rgb == 255).all(axis=-1).mean() < 0.01
    assert (rich.rgb == 255).all(axis=-1).mean() > 0.05


def test_the_figure_tells_the_scene_and_its_size(scene: Scene):
    figure = draw_scene(scene, Camera(32, 32))
    assert [panel.get_title() for panel in figure.axes] == ["room: 24 m²", "", ""]
    assert figure.axes[1].images[0].get_array().shape == (32, 32, 3)
