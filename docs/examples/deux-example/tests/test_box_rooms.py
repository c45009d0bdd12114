import numpy as np
import pytest

from deux.contracts import Robot, SceneSource
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.testing.scenes import SceneSourceSuite
from deux_example.box_rooms import BoxRooms


class TestBoxRooms(SceneSourceSuite):
    def make_source(self) -> SceneSource:
        return BoxRooms(train=2, validation=1, test=1)


def test_the_robot_has_less_floor_than_the_room_and_most_of_what_is_left() -> None:
    for reference in BoxRooms(train=3).splits().train:
        scene = reference.load()
        width, _, length = np.ptp(scene.mesh.bounds, axis=0)
        robot = Robot()
        simulator = registry().create("simulators", "mesh", {}, reference, Camera(16, 16), robot, False)
        free = simulator.free_space().area
        assert 0.4 * scene.floors[0].area < free < (width - 2 * robot.radius) * (length - 2 * robot.radius)
        assert scene.floors[0].area < width * length


def test_each_piece_stands_in_the_room_and_no_two_touch() -> None:
    mesh = BoxRooms(train=1, furniture=4).splits().train[0].load().mesh
    corners = mesh.triangles
    boxes = [corners[mesh.face_material == material].reshape(-1, 3) for material in range(3, len(mesh.materials))]
    assert 1 <= len(boxes) <= 4
    for number, box in enumerate(boxes):
        low, high = box.min(axis=0), box.max(axis=0)
        assert low[1] == pytest.approx(0.0, abs=1e-6)
        assert (low >= mesh.bounds[0] - 1e-6).all()
        assert (high <= mesh.bounds[1] + 1e-6).all()
        for other in boxes[:number]:
            assert (low > other.max(axis=0))[[0, 2]].any() or (other.min(axis=0) > high)[[0, 2]].any()


def test_a_bare_room_is_labelled_by_its_sides() -> None:
    mesh = BoxRooms(train=1, furniture=0).splits().train[0].load().mesh
    width, height, length = np.ptp(mesh.bounds, axis=0)
    sides = np.cross(mesh.triangles[:, 1] - mesh.triangles[:, 0], mesh.triangles[:, 2] - mesh.triangles[:, 0])
    areas = np.bincount(mesh.face_label, np.linalg.norm(sides, axis=1) / 2, minlength=len(mesh.label_names))
    expected = [width * length, width * length, 2 * height * (width + length), 0.0, 0.0, 0.0]
    np.testing.assert_allclose(areas, expected, rtol=1e-5)
    assert np.ptp(mesh.vertices[mesh.faces[mesh.face_label == 0], 1]) == 0.0


def test_a_negative_number_of_rooms_is_refused() -> None:
    with pytest.raises(DeuxError, match=r"scenes\.test is -1"):
        BoxRooms(test=-1)
