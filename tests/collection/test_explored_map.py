import numpy as np
import pytest

from deux.collection.explored_map import episode_poses, explored_map, map_of, mean_uncertainty
from deux.contracts import Explorer, ExplorerMap, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.io.calibration import write_matrix
from deux.io.images import write_depth
from deux.io.layout import SequencePaths
from deux.mapping.occupancy import FREE, OCCUPIED

CAMERA = Camera(width=32, height=32)
ROBOT = Robot()


def wall_ahead(folder) -> SequencePaths:
    """One frame at the origin looking along -Z at a wall, above an endless floor."""
    paths = SequencePaths(folder)
    rays = CAMERA.rays()
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 1] > 0, ROBOT.camera_height / rays[..., 1], np.inf)
    for kind in ("image", "ground_truth", "absolute_pose"):
        paths.file(kind, "000000").parent.mkdir(parents=True)
    paths.file("image", "000000").touch()
    write_depth(paths.file("ground_truth", "000000"), np.minimum(floor, 2.0).astype(np.float32))
    write_matrix(paths.file("absolute_pose", "000000"), camera_pose(0.0, ROBOT.camera_height, 0.0, 0.0))
    return paths


def test_without_a_map_of_its_own_the_frames_make_one(tmp_path):
    paths = wall_ahead(tmp_path / "sequence")
    explored = explored_map(paths, CAMERA, ROBOT)
    assert explored.occupancy[explored.frame.cell(0.0, -1.96)] == OCCUPIED
    assert explored.occupancy[explored.frame.cell(0.0, -1.5)] == FREE
    assert explored.uncertainty is None
    assert np.allclose(episode_poses(paths)[0], camera_pose(0.0, ROBOT.camera_height, 0.0, 0.0))


def test_the_explorers_own_map_is_preferred(tmp_path):
    paths = wall_ahead(tmp_path / "sequence")
    occupancy, uncertainty = np.full((3, 4), 2, np.int8), np.full((3, 4), 0.25, np.float32)
    np.savez(
        paths.folder / "map.npz",
        occupancy=occupancy,
        uncertainty=uncertainty,
        origin=np.array([1.0, -2.0]),
        resolution=np.array(0.1),
    )
    explored = explored_map(paths, CAMERA, ROBOT)
    assert (explored.occupancy == occupancy).all()
    assert (explored.uncertainty == uncertainty).all()
    assert (explored.frame.origin_x, explored.frame.origin_z, explored.frame.resolution) == (1.0, -2.0, 0.1)


def test_the_uncertainty_is_a_mean_over_frames_and_not_over_episodes(tmp_path):
    found = [wall_ahead(tmp_path / name) for name in ("a", "b", "c")]
    assert mean_uncertainty(found) is None
    (found[0].folder / "uncertainty.csv").write_text("step,uncertainty\n0,nan\n1,nan\n2,0.1\n3,0.1\n4,0.1\n")
    (found[1].folder / "uncertainty.csv").write_text("step,uncertainty\n0,nan\n1,nan\n2,0.5\n")
    assert mean_uncertainty(found) == pytest.approx(0.2)


FRAME = GridFrame(0.0, 0.0, 4, 5)
CELLS = np.zeros((4, 5), np.int8)
NO_MAPS = {
    r"ndarray of 4 x 5, int8: it must be a deux\.contracts\.ExplorerMap with a GridFrame, or None\.": CELLS,
    "a map whose frame is None": ExplorerMap(None, CELLS),  # type: ignore[arg-type]
    r"a map whose occupancy is ndarray of 5 x 4, int8: it must be an ndarray of 4 x 5, int8, as its": ExplorerMap(
        FRAME, CELLS.T
    ),
    "a map whose occupancy is ndarray of 4 x 5, float64": ExplorerMap(FRAME, CELLS.astype(np.float64)),
    "a map whose uncertainty is ndarray of 4 x 5, int8: it must be an ndarray of 4 x 5, float32": ExplorerMap(
        FRAME, CELLS, CELLS
    ),
}


@pytest.mark.parametrize("told", NO_MAPS)
def test_the_explorer_is_named_for_what_is_no_map(told):
    class Mapping(Explorer):
        reset = act = None  # type: ignore[assignment]

        def map(self):
            return NO_MAPS[told]

    with pytest.raises(DeuxError, match=f"^the `map` of the explorer Mapping gives {told}"):
        map_of(Mapping())
