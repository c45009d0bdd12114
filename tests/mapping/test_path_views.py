import numpy as np
import pytest

from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.mapping.path_views import values_along_paths
from deux.mapping.surface_views import SurfaceViews, views_of
from deux.mapping.view_fan import NOTHING, cast_rays, headings, pixel_shares

CAMERA = Camera(64, 64)
FRAME = GridFrame(0.0, 0.0, 100, 100, 0.1)
YAWS = headings()[::6]


def room():
    occupancy = np.full(FRAME.shape, 2, np.int8)
    occupancy[:2] = occupancy[-2:] = 1
    occupancy[:, :2] = occupancy[:, -2:] = 1
    occupancy[40:44, 40:60] = 1
    return occupancy


PLACES = np.array([[5.05, 6.05], [5.05, 7.05], [2.05, 3.05], [7.05, 2.05]])


def rays_of(places=PLACES):
    return cast_rays(room(), FRAME, places, 5.0)


def values(surfaces, rays, paths=((), (), ()), worth=1.0):
    goal, place, heading = (np.array(part, np.int64) for part in paths)
    shares = pixel_shares(CAMERA, YAWS)
    return values_along_paths(surfaces, rays, np.full(rays.kind.shape, worth), shares, goal, place, heading)


def novelty(seen, views):
    """(1 + n) ** -(1 + s)."""
    return (1.0 + np.bitwise_count(seen)) ** -(1.0 + ((seen & views) != 0))


def seen_surfaces():
    """What four views of a room leave behind."""
    surfaces = SurfaceViews(CAMERA)
    for place, yaw in (([4.0, 6.0], 0.0), ([4.5, 6.0], 0.3), ([2.0, 2.0], 2.0), ([5.0, 8.0], 0.0)):
        rays = cast_rays(room(), FRAME, np.array([place]), 5.0, 720)
        surfaces.mark_seen(rays, pixel_shares(CAMERA, np.array([yaw]), 720) > 0.0)
    return surfaces


def test_without_a_path_a_value_is_the_sum_over_the_rays():
    surfaces, rays = seen_surfaces(), rays_of()
    new = np.where(rays.kind == NOTHING, 0.0, novelty(surfaces.seen_in(rays), views_of(rays)))
    expected = 0.7 * new @ pixel_shares(CAMERA, YAWS).T
    assert values(surfaces, rays, worth=0.7) == pytest.approx(expected)


def test_a_view_that_was_taken_on_the_way_is_worth_a_quarter_the_second_time():
    """(1 + 1) ** -2 where one view shows a cell; less in the cells of 0.4 m that it shows from two bearings."""
    surfaces, rays = SurfaceViews(CAMERA), rays_of()
    alone = values(surfaces, rays)
    twice = values(surfaces, rays, ([0], [0], [0]))
    assert 1.15 * alone[0, 0] < twice[0, 0] <= 1.25 * alone[0, 0]
    assert twice[1:] == pytest.approx(alone[1:])  # on nobody else's path


def test_views_of_other_surfaces_add_up():
    surfaces, rays = SurfaceViews(CAMERA), rays_of()
    alone = values(surfaces, rays)
    behind = len(YAWS) // 2
    both = values(surfaces, rays, ([0], [0], [behind]))
    assert both[0, 0] == pytest.approx(alone[0, 0] + alone[0, behind])


def test_the_order_of_the_way_counts_as_it_is_walked():
    """Points of a path are given from its goal backwards: the last one is seen first, and in full."""
    surfaces, rays = SurfaceViews(CAMERA), rays_of()
    alone = values(surfaces, rays)
    forth = values(surfaces, rays, ([2, 2], [1, 0], [0, 0]))[2]
    back = values(surfaces, rays, ([2, 2], [0, 1], [0, 0]))[2]
    assert forth == pytest.approx(back, rel=0.5)
    for first, total in ((alone[0, 0], forth), (alone[1, 0], back)):
        assert np.all(total > first)
        assert np.all(total < alone[0, 0] + alone[1, 0] + alone[2])
