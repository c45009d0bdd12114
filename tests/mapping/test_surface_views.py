import math

import numpy as np
import pytest

from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.surface_views import SurfaceViews, views_of
from deux.mapping.view_fan import NOTHING, RAYS, SURFACE, UNSEEN, cast_rays, pixel_shares

CAMERA = Camera(128, 128)
FRAME = GridFrame(-6.0, -6.0, 120, 120, 0.1)
AHEAD = 0
"""The ray of yaw 0, along -z."""


def walled(z=-4.0):
    """A free map with a wall along x whose face is at z; the wall is occupied behind it."""
    occupancy = np.full(FRAME.shape, 2, np.int8)
    occupancy[: round((z + 6.0) / 0.1)] = 1
    return occupancy


def look(surfaces, distance, residual, x=0.0, z=-4.05):
    """A frame of the wall, taken straight on from a distance along the floor."""
    pose = camera_pose(x, 1.25, z + distance, 0.0)
    surfaces.record(pose, np.full((128, 128), distance, np.float32), np.full((128, 128), residual, np.float32))


def rays_from(distance, x=0.0, occupancy=None):
    return cast_rays(walled() if occupancy is None else occupancy, FRAME, np.array([[x, -4.05 + distance]]), 5.0)


def ahead(surfaces, distance, **options):
    return surfaces.uncertainty(rays_from(distance, **options))[0, AHEAD]


def test_a_surface_is_as_uncertain_as_it_was_from_that_distance():
    surfaces = SurfaceViews(CAMERA)
    for distance, residual in ((0.5, 0.1), (2.0, 0.2), (4.0, 0.7)):
        look(surfaces, distance, residual)
    assert [ahead(surfaces, d) for d in (0.6, 1.5, 3.5)] == pytest.approx([0.1, 0.2, 0.7])


def test_it_falls_back_to_other_distances_and_then_to_the_mean():
    surfaces = SurfaceViews(CAMERA)
    look(surfaces, 0.5, 0.1)  # half a metre of the wall
    look(surfaces, 0.5, 0.3, x=3.0)
    assert ahead(surfaces, 2.0) == pytest.approx(0.1)
    assert ahead(surfaces, 0.5, x=-3.0) == pytest.approx(0.2)
    nothing = np.full((128, 128), np.nan, np.float32)
    surfaces.record(camera_pose(-3.0, 1.25, -3.5, 0.0), np.full((128, 128), 0.5, np.float32), nothing)
    assert ahead(surfaces, 0.5, x=-3.0) == pytest.approx(0.2)


def test_the_unknown_counts_with_the_mean_and_what_is_out_of_range_with_nothing():
    surfaces = SurfaceViews(CAMERA)
    unknown = np.where(walled() == 1, np.int8(0), walled())
    assert ahead(surfaces, 2.0, occupancy=unknown) == 1.0  # with nothing known, all is alike
    look(surfaces, 2.0, 0.4)
    rays = rays_from(2.0, occupancy=unknown)
    assert set(rays.kind[0].tolist()) == {NOTHING, UNSEEN}
    assert np.unique(surfaces.uncertainty(rays)[rays.kind == UNSEEN]) == pytest.approx([0.4])
    assert (surfaces.uncertainty(rays)[rays.kind == NOTHING] == 0.0).all()


def views_of_what_is_ahead(surfaces, distance):
    """In how many views it was seen, and whether the one from this distance is among them."""
    rays = rays_from(distance)
    seen = surfaces.seen_in(rays)[0, AHEAD]
    return int(np.bitwise_count(seen)), bool(seen & views_of(rays)[0, AHEAD])


def test_a_view_is_remembered_once_and_by_its_distance():
    surfaces = SurfaceViews(CAMERA)
    assert views_of_what_is_ahead(surfaces, 2.0) == (0, False)
    shown = pixel_shares(CAMERA, np.array([0.0])) > 0.0
    for _ in range(3):  # the same view again changes nothing
        surfaces.mark_seen(rays_from(2.0), shown)
        assert views_of_what_is_ahead(surfaces, 0.5) == (1, False)
        assert views_of_what_is_ahead(surfaces, 2.0) == (1, True)
    surfaces.mark_seen(rays_from(0.5), shown)
    assert views_of_what_is_ahead(surfaces, 4.0) == (2, False)
    assert views_of_what_is_ahead(surfaces, 2.0) == (2, True)


def test_a_view_from_another_bearing_is_another_view():
    surfaces = SurfaceViews(CAMERA)
    aslant = camera_pose(2.0, 1.25, -2.05, math.pi / 4)  # its optical axis meets the wall near x = 0
    rays = cast_rays(walled(), FRAME, aslant[[0, 2], 3][None], 5.0)
    only = np.zeros((1, RAYS), bool)
    only[0, round(math.pi / 4 / (2 * math.pi / RAYS))] = True
    assert rays.kind[only].tolist() == [SURFACE]
    surfaces.mark_seen(rays, only)
    met = rays.ends[only][0]
    straight = cast_rays(walled(), FRAME, np.array([[met[0], -2.05]]), 5.0)
    assert np.bitwise_count(surfaces.seen_in(straight)[0, AHEAD]) == 1
    assert not surfaces.seen_in(straight)[0, AHEAD] & views_of(straight)[0, AHEAD]
    assert surfaces.seen_in(rays)[only] == views_of(rays)[only]
    assert surfaces.seen_in(straight)[0, RAYS // 4] == 0
