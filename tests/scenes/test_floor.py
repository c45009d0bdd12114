import numpy as np
import pytest
import trimesh

from deux.contracts import Robot, SceneMesh
from deux.errors import DeuxError
from deux.scenes.floor import building_bounds, find_floors
from deux.scenes.free_space import free_space
from deux_plugins.scenes.apartments import apartment


def floor_height(mesh: SceneMesh) -> float:
    return find_floors(mesh)[0].height


def heights(mesh: SceneMesh) -> list[float]:
    return [round(floor.height, 2) for floor in find_floors(mesh)]


@pytest.fixture
def room(slab):
    """A closed 6 x 4 m room of thick walls, floor at 0.5, ceiling at 3."""
    shell = slab([0, 0.3, 0], [6, 3.2, 4])
    inside = slab([0.2, 0.5, 0.2], [5.8, 3.0, 3.8])
    inside.invert()
    return shell, inside


def test_floor_of_a_room_is_the_floor_not_the_slab_or_the_ceiling(mesh_of, room):
    assert floor_height(mesh_of(*room)) == pytest.approx(0.5, abs=1e-3)


def test_the_direction_of_faces_does_not_matter(mesh_of, room):
    turned = [part.copy() for part in room]
    for part in turned:
        part.invert()
    assert floor_height(mesh_of(*turned)) == pytest.approx(0.5, abs=1e-3)


def test_stray_geometry_below_the_floor_is_ignored(mesh_of, room, slab):
    pit = slab([10, -3, 10], [10.5, -2.5, 10.5])
    stairs = [slab([8, -0.2 * k - 0.1, k], [9, -0.2 * k, k + 0.3]) for k in range(8)]
    assert floor_height(mesh_of(*room, pit, *stairs)) == pytest.approx(0.5, abs=1e-3)


def test_furniture_over_most_of_the_floor_does_not_become_the_floor(mesh_of, room, slab):
    beds = [slab([x, 0.5, 0.3], [x + 1.0, 1.0, 3.0]) for x in (0.4, 1.8, 3.2, 4.6)]
    assert floor_height(mesh_of(*room, *beds)) == pytest.approx(0.5, abs=1e-3)


def test_the_lower_of_two_storeys_is_the_floor(mesh_of, slab):
    storeys = [slab([0, y - 0.2, 0], [6, y, 5]) for y in (0.0, 3.0, 6.0)]
    assert heights(mesh_of(*storeys)) == [0.0, 3.0], "the topmost slab is the roof"


def test_a_rough_scanned_floor_lies_at_its_middle(mesh_of):
    rng = np.random.default_rng(3)
    x, z = np.meshgrid(np.arange(0, 5, 0.05), np.arange(0, 5, 0.05))
    rough = rng.normal(0.7, 0.01, x.size)
    points = np.stack([x.ravel(), rough, z.ravel()], axis=-1)
    width = x.shape[1]
    corner = (np.arange(x.shape[0] - 1)[:, None] * width + np.arange(width - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + width, corner + 1], axis=-1),
            np.stack([corner + 1, corner + width, corner + width + 1], axis=-1),
        ]
    )
    assert floor_height(mesh_of(trimesh.Trimesh(points, faces, process=False))) == pytest.approx(0.7, abs=5e-3)


def test_walls_alone_are_no_floor(mesh_of, sheet):
    wall = sheet([0, 0, 0], [5, 0, 0], [5, 3, 0], [0, 3, 0])
    with pytest.raises(DeuxError, match="no floor to stand on"):
        floor_height(mesh_of(wall))


def test_a_crawl_space_is_no_floor(mesh_of, sheet):
    level = [sheet([0, y, 0], [5, y, 0], [5, y, 5], [0, y, 5]) for y in (0.0, 0.6)]
    assert floor_height(mesh_of(*level)) == pytest.approx(0.6, abs=1e-3)


@pytest.fixture
def storey(slab):
    """storey(y, length): walls of 2.6 m around an 8 m wide floor at height y, a slab of 0.3 m above them, and furniture
    where there is room for it."""

    def build(y: float, length: float = 6.0):
        walls = [
            slab([0, y, 0], [8, y + 2.6, 0.2]),
            slab([0, y, length - 0.2], [8, y + 2.6, length]),
            slab([0, y, 0], [0.2, y + 2.6, length]),
            slab([7.8, y, 0], [8, y + 2.6, length]),
        ]
        wardrobe, table = slab([5, y, 0.3], [7.5, y + 2.1, 1.0]), slab([1, y + 0.7, 1], [3, y + 0.75, 3])
        rug = slab([4, y, 2], [7, y + 0.02, 4])
        furniture = [wardrobe, table, rug] if length > 4.5 else []
        return [*walls, *furniture, slab([0, y + 2.6, 0], [8, y + 2.9, length])]

    return build


def test_each_storey_has_a_floor_and_roof_and_furniture_have_none(mesh_of, slab, storey):
    ground = slab([0, -0.3, 0], [8, 0, 6])
    assert heights(mesh_of(ground, *storey(0.0), *storey(2.9), *storey(5.8))) == [0.0, 2.9, 5.8]


def test_a_stair_opening_stays_out_of_both_floors(mesh_of, slab, storey):
    """The slab between the storeys leaves 3 m x 1.2 m open above a flight of stairs."""
    opened = [slab([0, 2.6, 0], [8, 2.9, 4.6]), slab([3.5, 2.6, 4.6], [8, 2.9, 6]), slab([0, 2.6, 5.8], [8, 2.9, 6])]
    stairs = [slab([0.3 + 0.25 * k, 0, 4.7], [0.55 + 0.25 * k, 0.24 * (k + 1), 5.7]) for k in range(12)]
    parts = [slab([0, -0.3, 0], [8, 0, 6]), *storey(0.0)[:-1], *opened, *stairs, *storey(2.9)]
    ground, upper = find_floors(mesh_of(*parts))
    assert (ground.height, upper.height) == pytest.approx((0.0, 2.9), abs=1e-3)
    space = free_space(mesh_of(*parts), upper.height, Robot())
    assert not space.free[space.frame.cell(1.5, 5.2)], "one falls down the stairs"
    assert space.free[space.frame.cell(4.0, 3.0)]


@pytest.mark.parametrize(
    ("length", "expected"),
    [
        pytest.param(6.0, [-2.9, 0.0], id="as large as the storey above: the lowest is the main floor"),
        pytest.param(1.5, [0.0], id="a quarter of it: too small for a storey"),
    ],
)
def test_a_basement_is_a_storey_where_it_is_large_enough(mesh_of, slab, storey, length, expected):
    basement = [slab([0, -3.2, 0], [8, -2.9, length]), *storey(-2.9, length)]
    assert heights(mesh_of(*basement, slab([0, -0.3, 0], [8, 0, 6]), *storey(0.0))) == expected


def test_the_ground_around_a_house_does_not_make_a_floor_of_its_roof(mesh_of, slab, storey):
    for margin in (1.0, 4.0, 8.0, 30.0):
        ground = slab([-margin, -0.3, -margin], [8 + margin, 0, 6 + margin])
        assert heights(mesh_of(ground, *storey(0.0))) == [0.0], f"with {margin} m of ground around it"


def test_a_terrace_belongs_to_the_storey_beside_it(mesh_of, slab, storey):
    """The upper storey covers half of the lower one; the rest of the lower one's roof is at its floor's height."""
    assert heights(mesh_of(slab([0, -0.3, 0], [8, 0, 6]), *storey(0.0), *storey(2.9, length=3.0))) == [0.0, 2.9]


def test_a_scene_without_any_ceiling_keeps_its_levels(mesh_of, slab):
    """Two halves of a scan whose ceilings were cut away, one a storey above the other."""
    halves = [slab([0, -0.2, 0], [6, 0, 5]), slab([6, 2.4, 0], [12, 2.6, 5])]
    lamp = slab([2, 2.0, 2], [2.5, 2.1, 2.5])
    lower, upper = find_floors(mesh_of(*halves, lamp))
    assert (lower.height, upper.height) == pytest.approx((0.0, 2.6), abs=1e-3)
    assert (lower.area, upper.area) == pytest.approx((30.0, 30.0), rel=0.02)


@pytest.mark.parametrize("reach", [1.0, 30.0, 120.0])
def test_a_house_is_found_on_its_ground_plane(mesh_of, slab, house, reach):
    """The ground is 0.1 m below the floor; at 120 m it is 1,000 times as large as the house."""
    ground = slab([-reach, -0.4, -reach], [8 + reach, -0.1, 6 + reach])
    mesh = mesh_of(ground, *house(door=True))
    (floor,) = find_floors(mesh)
    assert floor.height == pytest.approx(0.0, abs=1e-3)
    assert floor.area == pytest.approx(7.6 * 5.6, rel=0.15)
    assert building_bounds(mesh) == pytest.approx((0.0, 0.0, 8.0, 6.0), abs=1.1)


def test_the_underside_of_solid_ground_is_no_floor(mesh_of, slab, house):
    assert heights(mesh_of(*house(door=True), slab([-20, -5, -20], [28, -0.05, 26]))) == [0.0]


def test_a_garden_of_steps_and_trees_has_no_floors(mesh_of, slab, house):
    garden, terrace = slab([-30, -1, -30], [40, -0.1, 15]), slab([-30, -1, 15], [40, 1.5, 40])
    trees = [slab([x, 3, 10], [x + 3, 5, 13]) for x in (-20, -12, 14, 20)]
    assert heights(mesh_of(*house(), garden, terrace, *trees)) == [0.0]


def test_storeys_of_a_house_with_stairs(mesh_of, two_storeys):
    lower, upper = find_floors(mesh_of(*two_storeys()))
    assert (lower.height, upper.height) == pytest.approx((0.0, 2.9), abs=1e-3)
    assert (lower.area, upper.area) == pytest.approx((7.6 * 5.6, 7.6 * 5.6), rel=0.15)


def test_the_main_floor_is_the_largest(mesh_of, slab, storey):
    cellar = [slab([0, -3.1, 0], [8, -2.9, 3.5]), *storey(-2.9, 3.5)]
    assert heights(mesh_of(*cellar, slab([0, -0.3, 0], [8, 0, 6]), *storey(0.0))) == [0.0, -2.9]


def test_a_mezzanine_is_a_floor_where_it_is_large_enough(mesh_of, slab):
    """A hall of 5.5 m with a gallery at 2.7 m over a part of it."""
    for depth, expected in ((2.6, [0.0, 2.7]), (1.0, [0.0])):
        hall = [slab([0, -0.2, 0], [8, 0, 6]), slab([0, 5.5, 0], [8, 5.7, 6])]
        assert heights(mesh_of(*hall, slab([0, 2.5, 0], [8, 2.7, depth]))) == expected


@pytest.mark.parametrize("height", [6.0, 9.0, 15.0])
def test_the_floor_of_a_hall_counts_however_high_its_ceiling_is(mesh_of, slab, height):
    """A hall of 20 x 15 m with an office of 2.7 m in a corner, which is neither all of the building nor its floor."""
    hall = [slab([0, -0.2, 0], [20, 0, 15]), slab([0, height, 0], [20, height + 0.2, 15])]
    mesh = mesh_of(*hall, slab([0, 2.7, 0], [6, 2.8, 5]))
    (floor,) = find_floors(mesh)
    assert floor.height == pytest.approx(0.0, abs=1e-6)
    assert floor.area == pytest.approx(300.0, rel=0.02)
    assert free_space(mesh, 0.0, Robot()).area == pytest.approx(19.8 * 14.8, rel=0.02)


def test_split_levels_half_a_storey_apart_are_floors_and_those_of_one_room_are_one(mesh_of, slab):
    for rise, expected in ((1.4, [0.0, 1.4]), (0.3, [0.0])):
        halves = [slab([0, -0.2, 0], [5, 0, 6]), slab([5, rise - 0.2, 0], [10, rise, 6])]
        assert heights(mesh_of(*halves, slab([0, 4, 0], [10, 4.2, 6]))) == expected


@pytest.mark.parametrize("rise", [0.5, 1.5, 2.3])
def test_a_sloping_floor_is_one_floor_and_free_from_end_to_end(mesh_of, sheet, rise):
    """A room of 6 x 12 m that rises along z, under a ceiling that rises with it."""
    planes = [sheet([0, y, 0], [6, y, 0], [6, y + rise, 12], [0, y + rise, 12]) for y in (0.0, 2.6)]
    (floor,) = find_floors(mesh_of(*planes))
    assert floor.height == pytest.approx(rise / 2, abs=rise / 2 if rise < 1.2 else 0.1)
    space = free_space(mesh_of(*planes), floor.height, Robot())
    assert space.area == pytest.approx(5.8 * 11.8, rel=0.03)
    assert np.nanmax(space.heights) - np.nanmin(space.heights) == pytest.approx(rise, rel=0.05)


def test_a_slope_that_rises_by_more_than_a_floor_reaches_is_several(mesh_of, sheet):
    planes = [sheet([0, y, 0], [6, y, 0], [6, y + 4.8, 30], [0, y + 4.8, 30]) for y in (0.0, 2.6)]
    assert heights(mesh_of(*planes)) == pytest.approx([1.2, 3.6], abs=0.1)


def test_the_inside_of_thick_walls_is_no_floor(mesh_of, slab, house):
    """Solid walls stand on the floor slab's underside, and hardly any floor is left of the rooms."""
    mesh = mesh_of(*house(), slab([0.2, 0, 0.2], [7.8, 0.8, 4.3]))
    assert 0.0 in heights(mesh)
    assert -0.2 not in heights(mesh)


def test_generated_flats_have_the_one_floor_that_they_say():
    flat = apartment(3)
    (found,) = find_floors(flat.mesh)
    assert found.height == pytest.approx(flat.floor_height, abs=1e-6)
    assert found.area == pytest.approx(flat.floors[0].area, rel=0.25), "furniture stands on a part of it"


def test_real_scenes_stand_at_zero(small_house, lounge):
    assert small_house.floor_height == pytest.approx(0.0, abs=0.005)
    assert lounge.floor_height == pytest.approx(0.0, abs=0.015)
    assert len(small_house.floors) == len(lounge.floors) == 1


@pytest.mark.parametrize("inverted", [False, True])
def test_a_closed_box_is_a_room_whichever_way_its_faces_look(mesh_of, inverted):
    box = trimesh.creation.box(bounds=[[0, 1, 0], [4, 4, 5]])
    if inverted:
        box.invert()
    table = trimesh.creation.box(bounds=[[1, 1, 1], [2, 1.7, 2]])
    for furniture in ((), (table,)):
        (floor,) = find_floors(mesh_of(box, *furniture))
        assert floor.height == pytest.approx(1.0, abs=1e-5)
        assert floor.area == pytest.approx(20.0 - len(furniture), rel=0.01)
