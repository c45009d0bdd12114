import numpy as np
import pytest
from scipy import ndimage

from deux.environment.egocentric import CHANNELS, SAMPLES, Crops, egocentric_crop
from deux.errors import DeuxError
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.occupancy import FREE, OCCUPIED, UNKNOWN

FRAME = GridFrame(-4.0, -6.0, 120, 100, 0.1)
CHANNEL = {name: index for index, name in enumerate(CHANNELS)}


def crop(occupancy, pose, edge=4.0, pixels=40, visited=None, frame=FRAME):
    visited = np.zeros(occupancy.shape, bool) if visited is None else visited
    return egocentric_crop(occupancy, visited, frame, pose, edge, pixels)


def random_map(seed=0):
    """Blobs of the three kinds, a few cells large."""
    rng = np.random.default_rng(seed)
    return ndimage.zoom(rng.integers(0, 3, (24, 20)), 5, order=0).astype(np.int8)


def test_a_wall_one_metre_ahead_is_one_metre_up():
    occupancy = np.full(FRAME.shape, FREE, np.int8)
    row, _ = FRAME.cells(0.0, -1.05)
    occupancy[row] = OCCUPIED
    near = crop(occupancy, camera_pose(1.0, 1.25, 0.0, 0.0))  # at x = 1, z = 0, looking along -Z
    # 40 pixels of 0.1 m: the robot is between rows 19 and 20, the wall 10 rows above.
    expected = np.zeros((40, 40))
    expected[9] = 255
    np.testing.assert_array_equal(near[CHANNEL["occupied"]], expected)
    np.testing.assert_array_equal(near[CHANNEL["free"]], 255 - expected)
    assert not near[[CHANNEL["unknown"], CHANNEL["visited"]]].any()


def test_what_is_right_of_the_robot_is_right():
    occupancy = np.full(FRAME.shape, FREE, np.int8)
    visited = np.zeros(FRAME.shape, bool)
    occupancy[FRAME.cells(2.05, -0.05)] = OCCUPIED  # right of somebody who looks along -Z is +X
    visited[FRAME.cells(0.95, 0.55)] = True  # and behind is +Z
    near = crop(occupancy, camera_pose(1.0, 1.25, 0.0, 0.0), visited=visited)
    assert np.argwhere(near[CHANNEL["occupied"]]).tolist() == [[19, 30]]
    assert np.argwhere(near[CHANNEL["visited"]]).tolist() == [[25, 19]]


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_robot_that_turned_by_90_degrees_sees_the_crop_turned(turns):
    occupancy, place = random_map(), (0.512, 1.25, 0.237)
    visited = np.random.default_rng(1).random(FRAME.shape) < 0.5
    ahead = crop(occupancy, camera_pose(*place, 0.0), visited=visited)
    left = crop(occupancy, camera_pose(*place, turns * np.pi / 2.0), visited=visited)
    # What was ahead of a robot that turned left is now on its right: the picture turns clockwise.
    np.testing.assert_array_equal(left, np.rot90(ahead, -turns, axes=(1, 2)))


@pytest.mark.parametrize(("edge", "pixels"), [(4.0, 32), (16.0, 32), (7.0, 24)])
def test_any_heading_agrees_with_scipy(edge, pixels):
    """Points of the camera's own axes, carried into the world by its pose and looked up by `map_coordinates`."""
    occupancy = random_map()
    visited = np.random.default_rng(1).random(FRAME.shape) < 0.2
    for seed in range(5):
        rng = np.random.default_rng(seed)
        pose = camera_pose(rng.uniform(-4, 6), 1.25, rng.uniform(-6, 6), rng.uniform(-np.pi, np.pi))
        offsets = ((np.arange(pixels * SAMPLES) + 0.5) / (pixels * SAMPLES) - 0.5) * edge
        right, down = np.meshgrid(offsets, offsets)
        points = pose @ np.stack([right, 0 * right, -down, 0 * right + 1]).reshape(4, -1)
        cells = [(points[2] + 6.0) / 0.1 - 0.5, (points[0] + 4.0) / 0.1 - 0.5]

        def share(layer, outside, cells=cells, pixels=pixels):
            there = ndimage.map_coordinates(layer.astype(float), cells, order=0, mode="grid-constant", cval=outside)
            return there.reshape(pixels, SAMPLES, pixels, SAMPLES).mean(axis=(1, 3))

        layers = [(occupancy == FREE, 0), (occupancy == OCCUPIED, 0), (occupancy == UNKNOWN, 1), (visited, 0)]
        expected = np.stack([share(layer, outside) for layer, outside in layers])
        found = crop(occupancy, pose, edge, pixels, visited)
        wrong = np.abs(found / 255.0 - expected) > 1.0 / 255.0
        assert wrong.mean() < 2e-3, "but for points on a border of two cells"


def test_a_pixel_holds_the_share_of_its_area():
    """Pixels of 0.3 m over columns of 0.1 m, of which every third is a wall."""
    occupancy = np.full(FRAME.shape, FREE, np.int8)
    occupancy[:, ::3] = OCCUPIED
    far = crop(occupancy, camera_pose(0.5, 1.25, 0.0, 0.0), edge=3.0, pixels=10)
    assert (far[CHANNEL["occupied"]] == 85).all()
    assert (far[CHANNEL["free"]] == 170).all()


def test_outside_the_map_all_is_unknown():
    occupancy = np.full(FRAME.shape, FREE, np.int8)
    near = crop(occupancy, camera_pose(-4.0, 1.25, 0.0, 0.0), visited=np.ones(FRAME.shape, bool))
    left, right = near[:, :, :20], near[:, :, 20:]
    assert (left[CHANNEL["unknown"]] == 255).all()
    assert not left[CHANNEL["visited"]].any()
    assert (right[CHANNEL["free"]] == 255).all()
    empty = GridFrame(0.0, 0.0, 0, 0, 0.1)
    nothing = crop(np.zeros((0, 0), np.int8), camera_pose(0.0, 1.25, 0.0, 0.0), frame=empty)
    assert (nothing[CHANNEL["unknown"]] == 255).all()


def test_the_shape_is_that_of_the_crops():
    found = egocentric_crop(random_map(), np.zeros(FRAME.shape, bool), FRAME, camera_pose(0, 1.25, 0, 0.3), 16.0, 16)
    assert found.shape == Crops(pixels=16).shape == (4, 16, 16)
    assert found.dtype == np.uint8


@pytest.mark.parametrize(
    ("option", "value"), [("near", 0.0), ("far", -1.0), ("near", float("nan")), ("pixels", 0), ("pixels", 30)]
)
def test_impossible_crops_are_refused(option, value):
    with pytest.raises(DeuxError, match=rf"crops\.{option} is {value}"):
        Crops(**{option: value})
