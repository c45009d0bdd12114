import numpy as np
import pytest

from deux.contracts import Channel, Robot
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.residual_field import PoseResidualField, SurfaceResidualField
from deux.testing.box_world import Box, BoxWorld

FRAME = GridFrame(-5.0, -5.0, 200, 200)
CAMERA = Camera(64, 64)
NOTHING = np.zeros((64, 64), np.float32)


@pytest.fixture(params=["pose", "surface"])
def field(request):
    return PoseResidualField() if request.param == "pose" else SurfaceResidualField(CAMERA)


def test_with_nothing_recorded_every_place_is_alike_and_the_grid_is_empty(field):
    assert field.at(np.array([[0.0, 0.0], [3.0, 1.0]])).tolist() == [0.0, 0.0]
    assert np.isnan(field.grid(FRAME)).all()
    missing = np.full((64, 64), np.nan, np.float32)
    field.update(camera_pose(0, 1.25, 0, 0), np.ones((64, 64), np.float32), missing, float("nan"))
    assert field.at(np.array([[0.0, 0.0]])).tolist() == [0.0]
    assert np.isnan(field.grid(FRAME)).all()


def test_far_away_it_tends_to_the_mean(field):
    depth = np.full((64, 64), 1.0, np.float32)
    for x, residual in ((-2.0, 0.1), (2.0, 0.3)):
        uncertainty = 1.0 - np.exp(-residual)
        field.update(camera_pose(x, 1.25, 0, 0), depth, np.full((64, 64), residual, np.float32), uncertainty)
    mean = np.mean([1.0 - np.exp(-0.1), 1.0 - np.exp(-0.3)])
    far = field.at(np.array([[0.0, 40.0], [-300.0, 2.0]]))
    assert far == pytest.approx([mean, mean], rel=0.02)


def test_the_pose_field_is_the_weighted_average_of_nearby_poses():
    field = PoseResidualField(bandwidth=0.8, prior_weight=0.25)
    rng = np.random.default_rng(0)
    poses, deltas = rng.uniform(-3, 3, (20, 2)), rng.random(20)
    for (x, z), delta in zip(poses, deltas, strict=True):
        field.update(camera_pose(x, 1.25, z, rng.random()), NOTHING, NOTHING, float(delta))
    for point in rng.uniform(-4, 4, (10, 2)):
        weights = [np.exp(-(np.hypot(*(point - pose)) ** 2) / (2 * 0.8**2)) for pose in poses]
        expected = (np.dot(weights, deltas) + 0.25 * deltas.mean()) / (sum(weights) + 0.25)
        assert field.at(point[None])[0] == pytest.approx(expected)


def test_the_pose_grid_agrees_with_point_queries_and_is_empty_far_from_the_poses():
    field = PoseResidualField()
    field.update(camera_pose(0, 1.25, 0, 0), NOTHING, NOTHING, 0.2)
    field.update(camera_pose(1, 1.25, 0, 0), NOTHING, NOTHING, 0.4)
    grid = field.grid(FRAME)
    cell = FRAME.cell(0.6, 0.4)
    assert grid[cell] == pytest.approx(field.at(np.array([FRAME.centre(*cell)]))[0], rel=1e-6)
    assert np.isnan(grid[FRAME.cell(0.0, 4.0)])


def test_surface_residuals_land_on_the_surfaces_that_show_them():
    """A box with residual 0.5 in a room with residual 0.1, seen from all sides."""
    box = Box(3.0, 1.0, 3.6, 1.6, 1.0)
    world = BoxWorld(5.0, 4.0, (box,), CAMERA)
    field = SurfaceResidualField(CAMERA, bandwidth=0.1)
    for degrees in range(0, 360, 30):
        world.reset(1.5, 2.0, np.radians(degrees))
        frame = world.observe(frozenset({Channel.LABELS}))
        residual = np.where(frame.labels == 1, 0.5, 0.1).astype(np.float32)
        field.update(frame.pose, frame.depth, residual, 0.1)
    high, low = 1.0 - np.exp(-0.5), 1.0 - np.exp(-0.1)
    floor_frame = GridFrame(0.0, 0.0, 80, 100)
    grid = field.grid(floor_frame)
    assert np.nanmax(grid) == pytest.approx(high, rel=1e-4)
    assert np.nanmin(grid) == pytest.approx(low, rel=1e-4)
    rows, columns = np.nonzero(grid > 0.5 * (high + low))
    centres = np.array([floor_frame.centre(r, c) for r, c in zip(rows, columns, strict=True)])
    assert (centres >= [box.x0 - 0.05, box.z0 - 0.05]).all()
    assert (centres <= [box.x1 + 0.05, box.z1 + 0.05]).all()
    near_box, wall = field.at(np.array([[3.05, 1.5], [0.05, 2.0]]))
    assert near_box > 2.0 * wall
    assert wall == pytest.approx(low, rel=0.1)


def test_the_surface_field_averages_over_frames_and_skips_missing_residuals():
    field = SurfaceResidualField(CAMERA, bandwidth=0.05, prior_weight=1e-6)
    pose = camera_pose(0, 1.25, 0, 0)
    depth = np.full((64, 64), 2.0, np.float32)
    for residual in (0.1, 0.3):
        image = np.full((64, 64), residual, np.float32)
        image[:, 32:] = np.nan
        field.update(pose, depth, image, 0.2)
    grid = field.grid(FRAME)
    assert np.unique(grid[np.isfinite(grid)]) == pytest.approx([1.0 - np.exp(-0.2)], rel=1e-5)
    _, columns = np.nonzero(np.isfinite(grid))
    assert columns.max() <= FRAME.cell(0.0, -2.0)[1], "the right half of the image showed nothing"


def test_the_surface_grid_follows_the_frame_that_is_asked_for():
    field = SurfaceResidualField(CAMERA)
    depth = np.full((64, 64), 2.0, np.float32)
    field.update(camera_pose(0, Robot().camera_height, 0, 0), depth, depth * 0.1, 0.2)
    moved = GridFrame(-1.0, -3.0, 60, 50)
    top, left = FRAME.cell(-1.0 + 1e-6, -3.0 + 1e-6)
    expected = field.grid(FRAME)[top : top + 60, left : left + 50]
    assert np.isfinite(expected).any()
    assert np.array_equal(field.grid(moved), expected, equal_nan=True)


def test_the_pose_grid_of_a_long_walk_is_that_of_all_cells_and_poses_at_once():
    rng = np.random.default_rng(0)
    walk, deltas = np.cumsum(rng.normal(0.0, 0.25, (400, 2)), axis=0), rng.random(400)
    field = PoseResidualField()
    for (x, z), delta in zip(walk, deltas, strict=True):
        field.update(camera_pose(x, 1.25, z, 0), NOTHING, NOTHING, float(delta))
    frame = GridFrame(walk[:, 0].min() - 6.0, walk[:, 1].min() - 6.0, 300, 200, resolution=0.1)
    z, x = np.mgrid[:300, :200]
    centres = np.stack([frame.origin_x + (x + 0.5) * 0.1, frame.origin_z + (z + 0.5) * 0.1], axis=-1)
    weights = np.exp(-((centres[:, :, None] - walk) ** 2).sum(-1) / (2 * 0.5**2))
    expected = (weights @ deltas + 0.01 * deltas.mean()) / (weights.sum(-1) + 0.01)
    expected[weights.sum(-1) <= np.exp(-2.0)] = np.nan
    np.testing.assert_allclose(field.grid(frame), expected, rtol=1e-5)
