import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from deux.contracts import (
    COLOR,
    DEPTH,
    Action,
    Channel,
    Floor,
    Material,
    Robot,
    Scene,
    SceneArea,
    SceneReference,
    Simulator,
)
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose, yaw_of
from deux.scenes.objects import find_objects
from deux.simulator.egl_context import EGLContext
from deux.simulator.mesh_simulator import MeshSimulator
from deux.testing.simulators import SimulatorSuite

CAMERA = Camera(32, 32)

Refer = Callable[[Scene], SceneReference]


@pytest.fixture(scope="module")
def flat_simulator(flat: Scene, refer: Refer) -> MeshSimulator:
    return MeshSimulator(refer(flat), CAMERA, Robot())


@pytest.fixture(scope="module")
def two_storeys(make_quads: Callable[..., Scene], box: Scene, refer: Refer) -> SceneReference:
    """The box and another one 0.3 m above its ceiling."""
    mesh = box.mesh
    upper = mesh.vertices + np.float32([0.0, 2.8, 0.0])
    doubled = replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, upper]),
        faces=np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)]),
        uv=np.tile(mesh.uv, (2, 1, 1)),
        face_material=np.tile(mesh.face_material, 2),
        face_label=np.tile(mesh.face_label, 2),
    )
    scene = replace(box, mesh=doubled, floors=(Floor(0.0, 12.0), Floor(2.8, 12.0)))
    return replace(refer(scene), area=SceneArea(floor="all"))


class TestMeshSimulator(SimulatorSuite):
    """In a furnished flat."""

    @pytest.fixture(autouse=True)
    def _simulator(self, flat_simulator: MeshSimulator) -> None:
        self.simulator = flat_simulator

    def make_simulator(self, camera: Camera) -> Simulator:
        return self.simulator.another(camera)


class TestTwoStoreys(SimulatorSuite):
    """In a building of two bare storeys."""

    @pytest.fixture(autouse=True)
    def _scene(self, two_storeys: SceneReference) -> None:
        self.scene = two_storeys

    def make_simulator(self, camera: Camera) -> Simulator:
        return MeshSimulator(self.scene, camera, Robot())


class TestOpenGL(TestTwoStoreys):
    """Drawn by pyrender."""

    def make_simulator(self, camera: Camera) -> Simulator:
        try:
            EGLContext(8, 8)
        except DeuxError as error:
            pytest.skip(str(error))
        return MeshSimulator(self.scene, camera, Robot(), renderer="pyrender")


def test_it_walks_turns_and_sees(box: Scene, refer: Refer) -> None:
    simulator = MeshSimulator(refer(box), CAMERA, Robot())
    simulator.reset(2.0, 2.0, 0.0)
    np.testing.assert_allclose(simulator.pose, camera_pose(2.0, 1.25, 2.0, 0.0))
    assert simulator.step(Action.FORWARD) is False
    np.testing.assert_allclose(simulator.pose, camera_pose(2.0, 1.25, 1.75, 0.0), atol=1e-6)
    assert simulator.step(Action.LEFT) is False
    assert yaw_of(simulator.pose) == pytest.approx(math.radians(10))
    simulator.step(Action.FORWARD)
    moved = simulator.pose[:3, 3] - (2.0, 1.25, 1.75)
    np.testing.assert_allclose(moved, [-0.0434120, 0.0, -0.2462019], atol=1e-6)
    simulator.step(Action.RIGHT)
    assert simulator.step(Action.STOP) is False
    assert yaw_of(simulator.pose) == pytest.approx(0.0, abs=1e-12)

    frame = simulator.observe(COLOR | {Channel.LABELS})
    np.testing.assert_allclose(frame.depth[16, 16], frame.pose[2, 3], atol=1e-5)
    assert frame.labels is not None
    assert simulator.label_names[frame.labels[16, 16]] == "quad 4"  # low end of z


def test_turns_add_up_exactly(box: Scene, refer: Refer) -> None:
    simulator = MeshSimulator(refer(box), CAMERA, Robot())
    simulator.reset(2.0, 1.5, 0.4)
    start = simulator.pose
    for _ in range(36):
        simulator.step(Action.LEFT)
    np.testing.assert_allclose(simulator.pose, start, atol=1e-12)


def test_it_stops_at_the_wall_a_radius_away(box: Scene, refer: Refer) -> None:
    simulator = MeshSimulator(refer(box), CAMERA, Robot())
    simulator.reset(2.0, 1.5, 0.0)
    collisions = [simulator.step(Action.FORWARD) for _ in range(12)]
    assert collisions == sorted(collisions)
    assert collisions[-1]
    assert 0.1 <= simulator.pose[2, 3] <= 0.16  # the radius, up to a cell


def test_the_camera_is_above_the_floor_that_it_is_put_on(two_storeys: SceneReference) -> None:
    simulator = MeshSimulator(two_storeys, CAMERA, Robot(camera_height=0.8))
    for floor, height in enumerate((0.0, 2.8)):
        simulator.reset(2.0, 1.5, 0.0, floor)
        simulator.step(Action.FORWARD)
        assert simulator.pose[1, 3] == pytest.approx(height + 0.8)
        assert simulator.free_space(floor) is simulator.free_space(floor)
        assert simulator.free_space(floor).floor_height == height
    with pytest.raises(DeuxError, match="has no floor 2: its floors are numbered 0 to 1"):
        simulator.free_space(2)


@pytest.mark.parametrize(("floor", "heights"), [("largest", [0.0]), (0, [0.0]), (1, [2.8])])
def test_it_offers_the_floor_that_the_area_chooses(
    two_storeys: SceneReference, floor: int | Literal["largest"], heights: list[float]
) -> None:
    simulator = MeshSimulator(replace(two_storeys, area=SceneArea(floor)), CAMERA, Robot())
    assert [found.height for found in simulator.floors] == heights
    simulator.reset(2.0, 1.5, 0.0)
    assert simulator.pose[1, 3] == pytest.approx(heights[0] + 1.25)
    with pytest.raises(DeuxError, match="has no floor 1"):
        simulator.reset(2.0, 1.5, 0.0, 1)


def test_it_stays_in_its_region(two_storeys: SceneReference) -> None:
    area = SceneArea(region=(1.0, 0.0, 3.0, 1.2), start=(2.0, 1.0))
    simulator = MeshSimulator(replace(two_storeys, area=area), CAMERA, Robot())
    with pytest.raises(DeuxError, match="cannot stand at"):
        simulator.reset(2.0, 1.5, 0.0)
    simulator.reset(2.0, 1.0, math.pi)  # looks along +Z
    while not simulator.step(Action.FORWARD):
        pass
    assert simulator.pose[2, 3] == pytest.approx(1.2, abs=0.05)


def test_the_camera_rises_with_the_steps_and_ramps_that_it_is_on(
    make_quads: Callable[..., Scene], refer: Refer
) -> None:
    """A floor, a ramp from 0 to 0.5 m over 2 m, and a level behind it that begins with a step of 0.1 m; no ceiling."""
    floor = [[[0, 0, 2], [2, 0, 2], [2, 0, 0], [0, 0, 0]], [[2, 0, 2], [4, 0.5, 2], [4, 0.5, 0], [2, 0, 0]]]
    level = [[[4, 0.6, 2], [6, 0.6, 2], [6, 0.6, 0], [4, 0.6, 0]]]
    materials = tuple(Material(name) for name in ("floor", "ramp", "level"))
    simulator = MeshSimulator(refer(make_quads(np.array(floor + level, float), materials)), CAMERA, Robot())
    simulator.reset(0.5, 1.0, -math.pi / 2.0)  # looks along +X
    places = [simulator.pose[:3, 3]]
    while not simulator.step(Action.FORWARD):
        places.append(simulator.pose[:3, 3])
    x, y, _ = np.array(places).T
    assert x[-1] > 5.0
    expected = np.where(x < 4.0, np.interp(x, [2.0, 4.0], [0.0, 0.5]), 0.6)
    np.testing.assert_allclose(y - 1.25, expected, atol=0.015)
    np.testing.assert_allclose(np.diff(x), 0.25, atol=1e-6, err_msg="a step is measured along the floor plan")


def test_objects_are_those_of_the_faces_in_range(flat_simulator: MeshSimulator, flat: Scene) -> None:
    found = find_objects(flat.mesh)
    assert flat_simulator.object_labels == found.labels
    near = flat_simulator.another(Camera(64, 64, max_depth=2.0))
    space = near.free_space()
    row, column = np.argwhere(space.free)[len(np.argwhere(space.free)) // 2]
    seen = set()
    for yaw in np.linspace(0.0, 2.0 * math.pi, 5):
        near.reset(*space.frame.centre(row, column), yaw)
        frame = near.observe(frozenset({Channel.OBJECTS}))
        assert frame.objects is not None
        assert (frame.objects[frame.depth == 0.0] == -1).all()
        seen |= set(np.unique(frame.objects)) - {-1}
    assert seen, "it sees no furniture"


def test_without_colours_depth_is_the_same_and_no_texture_is_kept(flat: Scene, refer: Refer) -> None:
    bare = MeshSimulator(refer(flat), CAMERA, Robot(), colors=False)
    assert all(material.texture is None for material in bare._shared.scene.mesh.materials)
    pose = camera_pose(2.0, 1.25, 2.0, 0.3)[None]
    whole = MeshSimulator(refer(flat), CAMERA, Robot())
    np.testing.assert_array_equal(bare.observe(DEPTH, pose)[0].depth, whole.observe(DEPTH, pose)[0].depth)


def test_one_hierarchy_of_rays_serves_floors_and_cameras(
    two_storeys: SceneReference, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = []
    monkeypatch.setattr("deux.scenes.ray_caster.TriangleMesh", lambda *mesh: built.append(mesh))
    simulator = MeshSimulator(two_storeys, CAMERA, Robot())
    for robot in (simulator, simulator.another(), simulator.another(Camera(20, 20))):
        robot.observe(COLOR, camera_pose(2.0, 1.25, 2.0, 0.3)[None])
    assert len(built) == 1
    assert simulator._shared.caster is simulator.another()._shared.caster


def test_it_cannot_be_put_into_a_wall_or_moved_before_it_is_put(box: Scene, refer: Refer) -> None:
    simulator = MeshSimulator(refer(box), CAMERA, Robot())
    with pytest.raises(DeuxError, match="not in quads yet: call reset"):
        simulator.step(Action.FORWARD)
    with pytest.raises(DeuxError, match=r"cannot stand at x=0\.020, z=1\.500 in quads"):
        simulator.reset(0.02, 1.5, 0.0)
    with pytest.raises(DeuxError, match="cannot stand at x=50"):
        simulator.reset(50.0, 1.5, 0.0)


def test_a_wrong_renderer_is_an_error(box: Scene, refer: Refer) -> None:
    simulator = MeshSimulator(refer(box), CAMERA, Robot(), renderer="pyrnder")
    simulator.reset(2.0, 1.5, 0.0)
    with pytest.raises(DeuxError, match="did you mean pyrender"):
        simulator.observe()
