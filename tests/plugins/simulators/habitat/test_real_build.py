"""The adapter on a real Habitat-Sim, where one is installed, and the stand-in beside it."""

import importlib.util
import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from deux.contracts import COLOR, DEPTH, Action, Channel, Robot, Scene, Simulator
from deux.geometry.camera import Camera
from deux.simulator.mesh_simulator import MeshSimulator
from deux.testing.simulators import SimulatorSuite, starts
from deux_plugins.scenes.files import FileReference
from deux_plugins.simulators.habitat import HabitatSimulator
from deux_plugins.simulators.habitat.session import import_habitat

# What habitat_sim and its dependencies warn about is not this project's.
pytestmark = pytest.mark.filterwarnings("default")

CAMERA = Camera(400, 400, 90.0, 0.01, 100.0)


@pytest.fixture(scope="module", autouse=True)
def habitat_sim() -> ModuleType:
    if importlib.util.find_spec("habitat_sim") is None:
        pytest.skip("habitat_sim is not installed")
    return import_habitat()


@pytest.fixture(scope="module")
def house_file(shared_data: Callable[[str], Path]) -> FileReference:
    return FileReference("small_house", shared_data("scenes") / "small_house.glb")


@pytest.fixture(scope="module")
def house(habitat_sim: ModuleType, house_file: FileReference) -> HabitatSimulator:
    return HabitatSimulator(house_file, CAMERA, Robot())


class TestHouse(SimulatorSuite):
    # A step that ends beyond the navmesh's border by less than this is moved onto it, and may get longer.
    position_tolerance = 0.05

    @pytest.fixture(autouse=True)
    def _simulator(self, house: HabitatSimulator) -> None:
        self.simulator = house

    def make_simulator(self, camera: Camera) -> Simulator:
        return self.simulator.another(camera)


@pytest.fixture(scope="module")
def recorded(shared_data: Callable[[str], Path]) -> list[dict[str, np.ndarray]]:
    return [dict(np.load(path)) for path in sorted(shared_data("habitat").glob("pose_*.npz"))]


def sensor_pose(record: dict[str, np.ndarray]) -> np.ndarray:
    w, x, y, z = record["sensor_rotation_wxyz"]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = record["sensor_position"]
    return pose


def test_frames_are_those_that_were_recorded(house: HabitatSimulator, recorded: list[dict[str, np.ndarray]]) -> None:
    frames = house.observe(COLOR, np.stack([sensor_pose(record) for record in recorded]))
    errors = np.stack([np.abs(f.depth - r["depth"]) for f, r in zip(frames, recorded, strict=True)])
    assert np.percentile(errors, 95) < 3e-4
    different = [(f.rgb != r["rgb"]).any(axis=-1).mean() for f, r in zip(frames, recorded, strict=True)]
    assert max(different) < 1e-3


def test_frames_are_those_of_the_built_in_simulator(
    house: HabitatSimulator, house_file: FileReference, small_house: Scene
) -> None:
    built_in = MeshSimulator(house_file, CAMERA, Robot())
    assert house.floors[0].height == pytest.approx(built_in.floors[0].height, abs=2e-3)
    for start in starts(house, 6):
        house.reset(*start)
        seen, expected = house.observe(COLOR), built_in.observe(COLOR, house.pose[None])[0]
        assert np.percentile(np.abs(seen.depth - expected.depth), 95) < 1e-3
        assert np.abs(seen.rgb.astype(int) - expected.rgb).mean() < 6.0
    free, theirs = house.free_space(), built_in.free_space()
    cells = np.argwhere(free.free)
    rows, columns = theirs.frame.cells(*np.array([free.frame.centre(*cell) for cell in cells]).T)
    inside = theirs.frame.contains(rows, columns)
    common = theirs.free[rows[inside], columns[inside]].sum()
    assert common / (free.free.sum() + theirs.free.sum() - common) > 0.9


def test_steps_are_those_of_habitats_own_agent(house: HabitatSimulator, habitat_sim: ModuleType) -> None:
    session = house._shared.session
    controls = session._simulator.get_agent(0).controls
    node = session._simulator.get_agent(0).scene_node
    actuation = habitat_sim.ActuationSpec(amount=house.robot.forward_step)
    agreed = 0
    for start in starts(house, 10):
        house.reset(*start)
        for _ in range(12):
            place = house._standing
            state = habitat_sim.AgentState()
            state.position = place.point.astype(np.float32)
            state.rotation = [0.0, math.sin(place.yaw / 2.0), 0.0, math.cos(place.yaw / 2.0)]
            session._simulator.get_agent(0).set_state(state)
            collided = controls.action(node, "move_forward", actuation)
            assert house.step(Action.FORWARD) == collided
            np.testing.assert_allclose(house._standing.point, np.array(node.absolute_translation), atol=1e-4)
            agreed += collided
    assert agreed > 5, "it never came to a wall"


@pytest.fixture
def rooms(
    install: Callable[..., ModuleType],
    make_room: Callable[..., FileReference],
    boxes: list[dict],
    habitat_sim: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> tuple[HabitatSimulator, HabitatSimulator]:
    """One room in the real Habitat-Sim and in the stand-in."""
    camera, robot = Camera(64, 48), Robot()
    room = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [6.0, 2.5, 5.0]])
    room.invert()
    parts = [room, *(trimesh.creation.box(bounds=[box["low"], box["high"]]) for box in boxes)]
    path = tmp_path / "room.glb"
    trimesh.Scene(parts).export(path)
    real = HabitatSimulator(FileReference("room", path), camera, robot, colors=False)
    install()
    return real, HabitatSimulator(make_room(), camera, robot, colors=False)


def test_the_stand_in_is_as_the_real_one(rooms: tuple[HabitatSimulator, HabitatSimulator]) -> None:
    real, stand_in = rooms
    assert stand_in.floors[0].height == pytest.approx(real.floors[0].height, abs=1e-3)
    assert stand_in.floors[0].area == pytest.approx(real.floors[0].area, rel=0.02)
    space = stand_in.free_space()
    for start in starts(stand_in, 8):
        for one in rooms:
            one.reset(*start)
        assert real._standing.point[1] == pytest.approx(stand_in._standing.point[1], abs=1e-3)
        for action in (Action.FORWARD, Action.LEFT, Action.FORWARD, Action.RIGHT):
            collided = [one.step(action) for one in rooms]
            if space.clearance[space.frame.cell(*stand_in.pose[[0, 2], 3])] < 0.3:
                break  # at walls the real one rounds corners
            assert collided == [False, False]
            np.testing.assert_allclose(stand_in.pose, real.pose, atol=1e-3)
        pose = stand_in.pose[None]
        seen, expected = (one.observe(DEPTH, pose)[0].depth for one in rooms)
        assert np.percentile(np.abs(seen - expected), 95) < 1e-3


def write_mp3d(folder: Path, boxes: list[dict]) -> FileReference:
    """The room in Matterport3D's layout: Z-up, each box in a colour of its own and an object in the annotation."""
    turn = trimesh.transformations.rotation_matrix(math.pi / 2.0, [1.0, 0.0, 0.0])
    room = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [6.0, 2.5, 5.0]])
    room.invert()
    parts = [room, *(trimesh.creation.box(bounds=[box["low"], box["high"]]) for box in boxes)]
    for number, part in enumerate(parts):
        part.apply_transform(turn)
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=[200, 40 * number, 20, 255])
        part.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=material)
    trimesh.Scene(parts).export(folder / "room.glb")

    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + 8 * number for number, part in enumerate(parts)])
    points = np.zeros(len(vertices), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    points["xyz"] = vertices
    polygons = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", 3), ("object", "<i4")])
    polygons["count"], polygons["corners"], polygons["object"] = 3, faces, np.repeat(np.arange(len(parts)), 12)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        + "".join(f"property float {name}\n" for name in "xyz")
        + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
        + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nproperty int object_id\nend_header\n"
    )
    (folder / "room_semantic.ply").write_bytes(header.encode() + points.tobytes() + polygons.tobytes())

    zeros = " ".join("0" * 30)
    categories = ["wall", *(box["category"] for box in boxes)]
    lines = ["ASCII 1.1", f"H room - 1 1 0 0 {len(parts)} {len(parts)} 0 1 0 1 {zeros}", f"L 0 1 - {zeros}"]
    lines.append(f"R 0 0 0 0 k {zeros}")
    lines += [f"C {number} {number} {name} {number} {name} 0 0 0 0 0" for number, name in enumerate(categories)]
    lines += [f"O {number} 0 {number} 0 0 0 1 0 0 0 1 0 1 1 1 {zeros}" for number in range(len(parts))]
    (folder / "room.house").write_text("\n".join(lines) + "\n")
    return FileReference("room", folder / "room.glb", "z")


def test_labels_lie_on_what_they_name(boxes: list[dict], tmp_path: Path) -> None:
    simulator = HabitatSimulator(write_mp3d(tmp_path, boxes), Camera(64, 48), Robot())
    assert simulator.object_labels == ("wall", *(box["category"] for box in boxes))
    assert simulator.floors[0].height == pytest.approx(0.0, abs=1e-3)
    seen = set()
    for yaw in np.arange(8) * math.pi / 4.0:
        simulator.reset(3.5, 2.3, float(yaw))
        frame = simulator.observe(frozenset(Channel))
        assert frame.objects is not None
        np.testing.assert_array_equal(frame.objects, frame.rgb[..., 1] // 40)
        seen |= set(np.unique(frame.objects).tolist())
    assert seen == set(range(len(boxes) + 1))
