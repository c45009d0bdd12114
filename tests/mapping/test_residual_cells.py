import numpy as np
import pytest

from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.mapping import residual_cells
from deux.mapping.residual_cells import ResidualCells

CAMERA = Camera(24, 18)
RESOLUTION = 0.1
MAX_RANGE = 4.0


@pytest.mark.parametrize("distances", [(), (1.0, 3.0)])
def test_sums_and_numbers_are_those_of_the_pixels_points(distances):
    rng = np.random.default_rng(3)
    cells = ResidualCells(CAMERA, MAX_RANGE, RESOLUTION, distances)
    expected = [{} for _ in range(len(distances) + 1)]
    for pose in (camera_pose(0.33, 1.25, -2.07, 0.4), camera_pose(3.1, 1.0, 0.5, -2.0)):
        depth = rng.uniform(0.2, 6.0, (18, 24)).astype(np.float32)
        depth[0, :4] = (0.0, np.nan, -1.0, np.inf)
        residual = rng.random((18, 24)).astype(np.float32)
        residual[5, :3] = np.nan
        cells.add(pose, depth, residual)
        rows, columns = np.mgrid[:18, :24]
        rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(CAMERA.intrinsics).T
        with np.errstate(invalid="ignore"):
            points = (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
        distance = np.hypot(points[..., 0] - pose[0, 3], points[..., 2] - pose[2, 3])
        for place in zip(*np.nonzero((depth > 0) & np.isfinite(residual) & (distance <= MAX_RANGE)), strict=True):
            key = (int(np.floor(points[place][2] / RESOLUTION)), int(np.floor(points[place][0] / RESOLUTION)))
            expected[np.digitize(distance[place], distances)].setdefault(key, []).append(residual[place])
    frame = cells.grid.frame
    first = round(frame.origin_z / RESOLUTION), round(frame.origin_x / RESOLUTION)
    assert len(cells.totals) == len(cells.counts) == len(expected)
    for total, count, values in zip(cells.totals, cells.counts, expected, strict=True):
        assert count.sum() == sum(map(len, values.values())) > 0
        for (row, column), found in values.items():
            cell = row - first[0], column - first[1]
            assert count[cell] == len(found)
            assert total[cell] == pytest.approx(np.sum(found, dtype=np.float64), rel=1e-6)


def test_other_layers_lie_on_the_same_cells():
    cells = ResidualCells(CAMERA, MAX_RANGE, RESOLUTION, layers={"marks": np.int64})
    cells.add(camera_pose(0.0, 1.25, 0.0, 0.0), np.ones((18, 24), np.float32), np.ones((18, 24), np.float32))
    assert cells.grid["marks"].shape == cells.counts[0].shape == cells.grid.frame.shape
    assert cells.grid["marks"].dtype == np.int64
    assert not cells.grid["marks"].any()


def test_a_point_at_the_end_of_the_range_is_within_the_grid(monkeypatch):
    """The compiled code checks no index; as Python it does. Rounding brings such a point into the next row."""
    monkeypatch.setattr(residual_cells, "_add", residual_cells._add.py_func)
    depth, pose = np.zeros((17, 17), np.float32), np.eye(4)
    depth[8, 8] = 5.0
    for start in 0.05 * np.arange(-40, 40, 4):
        cells = ResidualCells(Camera(17, 17), 5.0, 0.05)
        for step in range(20):
            pose[2, 3] = start + 0.25 * step
            cells.add(pose, depth, np.ones((17, 17), np.float32))
