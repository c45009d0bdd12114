import math

import numpy as np
import pytest

from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.view_fan import GAP, NOTHING, RAYS, SURFACE, UNSEEN, cast_rays, headings, pixel_shares

FRAME = GridFrame(-2.0, 1.0, 60, 80, 0.1)


def walked(occupancy, place, yaw, reach):
    """A ray followed in steps of a thousandth of a cell: kind, cell (row, column), metres."""
    travelled = np.arange(0.0, reach, 1e-4)
    rows, columns = FRAME.cells(place[0] - math.sin(yaw) * travelled, place[1] - math.cos(yaw) * travelled)
    entered = 1 + np.flatnonzero((np.diff(rows) != 0) | (np.diff(columns) != 0))
    unknown, first = 0, None
    for row, column, metres in zip(rows[entered], columns[entered], travelled[entered], strict=True):
        if not (0 <= row < FRAME.rows and 0 <= column < FRAME.columns):
            break
        if occupancy[row, column] == 1:
            return SURFACE, (row, column), metres
        unknown = unknown + 1 if occupancy[row, column] == 0 else 0
        if unknown == 1:
            first = (row, column), metres
        if unknown == GAP:
            return UNSEEN, *first
    return NOTHING, None, reach


def test_rays_end_where_a_finely_stepped_ray_does():
    rng = np.random.default_rng(0)
    occupancy = rng.choice([0, 1, 2], FRAME.shape, p=[0.3, 0.03, 0.67]).astype(np.int8)
    places = np.stack([rng.uniform(-1.5, 5.5, 5), rng.uniform(1.5, 6.5, 5)], axis=1)
    rays = cast_rays(occupancy, FRAME, places, 3.0)
    agreed = []
    for n, place in enumerate(places):
        for r in range(0, RAYS, 5):
            kind, cell, metres = walked(occupancy, place, headings()[r], 3.0)
            same = rays.kind[n, r] == kind and abs(rays.distance[n, r] - metres) < 1e-3
            if same and cell is not None:
                same = rays.ends[n, r] == pytest.approx(FRAME.centre(*cell))
            agreed.append(same)
    assert np.mean(agreed) > 0.98  # the stepped ray misses corners that are cut by less than its step
    assert {NOTHING, SURFACE, UNSEEN} == set(rays.kind.ravel().tolist())


def test_distances_in_a_round_room_are_its_radius():
    rows, columns = np.mgrid[:60, :60]
    room = GridFrame(-3.0, -3.0, 60, 60, 0.1)
    occupancy = np.where(np.hypot(rows - 29.5, columns - 29.5) < 20.0, 2, 1).astype(np.int8)
    rays = cast_rays(occupancy, room, np.array([[0.0, 0.0]]), 5.0)
    assert (rays.kind == SURFACE).all()
    assert rays.distance[0] == pytest.approx(np.full(RAYS, 2.0), abs=0.15)


def test_gaps_of_the_map_do_not_stop_a_ray_and_leaving_the_grid_is_nothing():
    right = round(1.5 * math.pi / (2.0 * math.pi / RAYS))  # a quarter turn right: towards +x
    kinds = []
    for width in (GAP - 1, GAP):
        occupancy = np.full(FRAME.shape, 2, np.int8)
        occupancy[:, 40 : 40 + width] = 0
        rays = cast_rays(occupancy, FRAME, np.array([[1.0, 4.05]]), 9.0)
        kinds.append(rays.kind[0, right])
    assert kinds == [NOTHING, UNSEEN]
    assert rays.distance[0, right] == pytest.approx(1.0)


@pytest.mark.parametrize("yaw", [0.0, 0.3, 3.1])
def test_shares_are_those_of_the_images_columns(yaw):
    """The columns of a wide image are counted by the ray that is nearest to them."""
    camera = Camera(20001, 3, hfov=80.0)
    forward = camera.rays()[1] @ camera_pose(0.0, 1.0, 0.0, yaw)[:3, :3].T
    of_columns = np.arctan2(-forward[:, 0], -forward[:, 2])
    nearest = np.rint(of_columns / (2.0 * math.pi / RAYS)).astype(int) % RAYS
    counted = np.bincount(nearest, minlength=RAYS) / camera.width
    shares = pixel_shares(camera, np.array([yaw]))[0]
    assert shares == pytest.approx(counted, abs=3e-4)
    assert shares.sum() == pytest.approx(1.0)
