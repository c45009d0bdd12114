import json
import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from deux.contracts import COLOR, DEPTH, Action, Channel, Robot, SceneReference, Simulator
from deux.contracts.scene import SceneArea
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.testing.simulators import SimulatorSuite
from deux_plugins.simulators.habitat import HabitatSimulator

CAMERA = Camera(32, 24)
LABELS = frozenset({Channel.LABELS, Channel.OBJECTS})


class TestVersion033(SimulatorSuite):
    """Vectors are magnum's; a scene as of scenes=files."""

    @pytest.fixture(autouse=True)
    def _scene(self, install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]) -> None:
        install(vectors="magnum", version="0.3.3")
        self.scene = make_room()

    def make_simulator(self, camera: Camera) -> Simulator:
        return HabitatSimulator(self.scene, camera, Robot())


class TestVersion025(SimulatorSuite):
    """Vectors are arrays; a Z-up scene with MP3D's annotation, and a navmesh for another robot beside it."""

    @pytest.fixture(autouse=True)
    def _scene(self, install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]) -> None:
        install(vectors="numpy", version="0.2.5", navmesh_loaded=True)
        self.scene = make_room("z", ("_semantic.ply", ".house"))

    def make_simulator(self, camera: Camera) -> Simulator:
        return HabitatSimulator(self.scene, camera, Robot())


@pytest.fixture
def simulator(install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]) -> HabitatSimulator:
    install()
    return HabitatSimulator(make_room(), CAMERA, Robot())


@pytest.mark.parametrize("up", ["y", "z"])
def test_its_camera_is_that_high_above_the_floor_and_sees_the_walls(
    up: str, install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    install()
    simulator = HabitatSimulator(make_room(up), Camera(33, 33), Robot())
    assert simulator.floors[0].height == pytest.approx(0.0, abs=1e-3)
    # The room spans x 0 to 6, y 0 to 2.5 and z 0 to 5 of the world.
    simulator.reset(1.0, 2.0, 0.0)
    np.testing.assert_allclose(simulator.pose, camera_pose(1.0, 1.25, 2.0, 0.0), atol=1e-3)
    depth = simulator.observe(DEPTH).depth
    assert depth[16, 16] == pytest.approx(2.0, abs=1e-3)
    # 45 degrees to the left, down and up, at the outermost pixels' centres.
    edge = 16.0 / 16.5
    assert depth[16, 0] == pytest.approx(1.0 / edge, abs=2e-3)
    assert depth[32, 16] == pytest.approx(1.25 / edge, abs=2e-3)
    assert depth[0, 16] == pytest.approx(1.25 / edge, abs=2e-3)


@pytest.mark.parametrize("cell_height", [0.05, 0.2])
@pytest.mark.parametrize("vectors", ["magnum", "numpy"])
def test_the_navmesh_cells_do_not_lift_the_camera(
    cell_height: float, vectors: str, install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    install(vectors=vectors)
    simulator = HabitatSimulator(make_room(), CAMERA, Robot(), cell_height=cell_height)
    simulator.reset(1.0, 1.0, 0.0)
    assert simulator._shared.session.snapped(np.array([1.0, 0.1, 1.0]))[1] == pytest.approx(cell_height, abs=1e-6)
    for _ in range(3):
        assert simulator.pose[1, 3] == pytest.approx(1.25, abs=1e-3)
        simulator.step(Action.FORWARD)


@pytest.mark.parametrize("annotation", [("_semantic.ply", ".house"), (".semantic.glb", ".semantic.txt")])
def test_labels_lie_on_what_they_name(
    annotation: tuple[str, str], install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    install()
    simulator = HabitatSimulator(make_room("z", annotation), CAMERA, Robot())
    assert simulator.label_names == ("bed", "cabinet", "table")
    assert simulator.object_labels == ("table", "bed", "cabinet", "table")
    for yaw in np.arange(8) * math.pi / 4.0:
        simulator.reset(3.5, 2.3, float(yaw))
        frame = simulator.observe(frozenset(Channel))
        # The stand-in paints each box in a colour of its own.
        painted = (frame.rgb[..., 1].astype(int) - 90) // 20 - 1
        np.testing.assert_array_equal(frame.objects, np.where(frame.depth > 0.0, painted, -1))


def test_annotation_that_is_not_wanted_is_not_loaded(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    install()
    simulator = HabitatSimulator(make_room("z", ("_semantic.ply", ".house")), CAMERA, Robot(), semantics=False)
    assert simulator.label_names == simulator.object_labels == ()


def test_without_colours_no_colour_sensor_is_made(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    module = install()
    scene = make_room()
    blind = HabitatSimulator(scene, CAMERA, Robot(), colors=False)
    sensors = blind._shared.session._simulator._sensors
    assert not any(name.startswith("color") for name in sensors)
    seeing = HabitatSimulator(scene, CAMERA, Robot())
    pose = camera_pose(3.0, 1.25, 2.5, 0.3)[None]
    np.testing.assert_array_equal(blind.observe(DEPTH, pose)[0].depth, seeing.observe(COLOR, pose)[0].depth)
    assert module.Simulator.cards == 0


def test_the_navmesh_is_for_this_robot(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    scene = make_room()
    areas = []
    for loaded in (False, True):
        install(navmesh_loaded=loaded)
        areas.append(HabitatSimulator(scene, CAMERA, Robot()).free_space().area)
    assert areas[0] == areas[1]
    assert HabitatSimulator(scene, CAMERA, Robot(radius=0.4)).free_space().area < areas[0] - 1.0


def test_free_space_is_the_navmesh_of_the_floor(simulator: HabitatSimulator) -> None:
    space = simulator.free_space()
    rows, columns = np.mgrid[: space.frame.rows, : space.frame.columns]
    x = space.frame.origin_x + (columns + 0.5) * space.frame.resolution
    z = space.frame.origin_z + (rows + 0.5) * space.frame.resolution

    def within(x0: float, x1: float, z0: float, z1: float) -> np.ndarray:
        return (x > x0) & (x < x1) & (z > z0) & (z < z1)

    expected = within(0.1, 5.9, 0.1, 4.9)
    for low_x, high_x, low_z, high_z in (
        (2.0, 2.6, 1.0, 1.8),
        (4.2, 5.2, 2.9, 3.9),
        (0, 0.5, 3.2, 4.4),
        (3, 3.4, 4.6, 5),
    ):
        expected &= ~within(low_x - 0.1, high_x + 0.1, low_z - 0.1, high_z + 0.1)
    borders = np.abs(space.clearance - 0.1) < 0.11  # Recast rounds walls to cells
    np.testing.assert_array_equal(space.free[~borders], expected[~borders])
    assert 0.9 < space.area / (expected.sum() * 0.05**2) < 1.0


def test_a_place_that_the_navmesh_covers_in_part_is_moved_onto_it(simulator: HabitatSimulator) -> None:
    space = simulator.free_space()
    row = space.frame.cell(1.0, 1.0)[0]
    column = int(np.flatnonzero(space.free[row])[0])
    x, z = space.frame.centre(row, column)
    x = x - 0.5 * space.frame.resolution + 1e-4  # on the far side of the cell, nearer than its radius to the wall
    simulator.reset(x, z, math.pi / 2.0)
    assert math.dist((x, z), simulator.pose[[0, 2], 3]) < space.frame.resolution
    assert simulator.step(Action.FORWARD), "it faces a wall"
    for _ in range(18):
        simulator.step(Action.LEFT)
    assert not simulator.step(Action.FORWARD), "it is stuck at the wall"


def test_a_region_is_never_left(install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]) -> None:
    install()
    area = SceneArea(region=(0.0, 0.0, 1.475, 2.475))
    simulator = HabitatSimulator(make_room(area=area), CAMERA, Robot())
    assert simulator.free_space().area == pytest.approx(1.325 * 2.325, rel=0.05)
    simulator.reset(0.9, 1.0, -math.pi / 2.0)
    assert [simulator.step(Action.FORWARD) for _ in range(4)] == [False, False, True, True]
    assert simulator.pose[0, 3] == pytest.approx(1.4, abs=1e-3)


def test_a_configuration_of_the_users_is_taken_as_it_is(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference], tmp_path: Path
) -> None:
    install()
    scene = make_room("z")
    config = tmp_path / "set.scene_dataset_config.json"
    for axes, width in (({"up": [0, 0, 1], "front": [0, 1, 0]}, 5.0), ({"up": [0, 1, 0], "front": [0, 0, -1]}, 2.5)):
        config.write_text(json.dumps({"stages": {"paths": {".glb": [str(scene.file)]}, "default_attributes": axes}}))
        simulator = HabitatSimulator(scene, CAMERA, Robot(camera_height=1.0, height=1.2), dataset=str(config))
        free = np.argwhere(simulator.free_space().free)
        # Taken for a Y-up one, a Z-up file lies on its side: the room's height is along z.
        assert np.ptp(free[:, 0]) * 0.05 == pytest.approx(width - 0.35, abs=0.11)


def test_a_scene_that_cannot_be_loaded_is_named(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    module = install()

    class Failing(module.Simulator):
        def __init__(self, config: Any) -> None:
            if config.sim_cfg.scene_id != "NONE":
                raise RuntimeError("no stage\nof this name")
            super().__init__(config)

    module.Simulator = Failing
    scene = make_room()
    with pytest.raises(DeuxError, match=r"cannot load the scene room of .*room\.glb: no stage of this name\."):
        HabitatSimulator(scene, CAMERA, Robot())
    scene.file.unlink()
    with pytest.raises(DeuxError, match="the file of the scene room is missing"):
        HabitatSimulator(scene, CAMERA, Robot())


def test_a_robot_that_fits_nowhere_is_refused(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    install()
    with pytest.raises(DeuxError, match=r"room has no navmesh: a robot of .* fits nowhere in it"):
        HabitatSimulator(make_room(), CAMERA, Robot(height=3.0))


def test_a_step_before_the_first_reset_is_refused(simulator: HabitatSimulator) -> None:
    with pytest.raises(DeuxError, match="call reset"):
        simulator.step(Action.FORWARD)
