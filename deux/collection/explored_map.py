"""The map of an episode: its explorer's own, or one built from its stored frames."""

from collections.abc import Iterable

import numpy as np

from deux.broken_contracts import broken_contract
from deux.collection.free_floor import stored_grid
from deux.contracts import Explorer, ExplorerMap, Robot
from deux.errors import DeuxError, error_text, kind_of, sizes
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.io.arrays import read_arrays
from deux.io.calibration import read_pose
from deux.io.csv_files import number, read_table
from deux.io.images import read_depth
from deux.io.layout import SequencePaths
from deux.mapping.occupancy import OccupancyMap


def episode_poses(sequence: SequencePaths) -> np.ndarray:
    """Camera-to-world matrices of an episode's frames in order of time, N x 4 x 4."""
    return np.stack([read_pose(sequence.file("absolute_pose", frame)) for frame in sequence.frames()])


def map_of(explorer: Explorer) -> ExplorerMap | None:
    """The current map of an explorer; None if it keeps none.

    Raises:
        DeuxError: its `map` returns something else, or grids of the wrong size or type.
    """
    found: object = explorer.map()
    if found is None:
        return None
    if not (isinstance(found, ExplorerMap) and isinstance(found.frame, GridFrame)):
        frame = getattr(found, "frame", None)
        given = f"a map whose frame is {kind_of(frame)}" if isinstance(found, ExplorerMap) else kind_of(found)
        raise broken_contract(explorer, given, "a deux.contracts.ExplorerMap with a GridFrame, or None", "map")
    shape = found.frame.shape
    for name, grid, dtype in (("occupancy", found.occupancy, np.int8), ("uncertainty", found.uncertainty, np.float32)):
        if grid is None and name == "uncertainty":
            continue
        if not (isinstance(grid, np.ndarray) and grid.shape == shape and grid.dtype == dtype):
            wanted = f"an ndarray of {sizes(shape)}, {np.dtype(dtype)}, as its frame says"
            raise broken_contract(explorer, f"a map whose {name} is {kind_of(grid)}", wanted, "map")
    return found


def explored_map(sequence: SequencePaths, camera: Camera, robot: Robot) -> ExplorerMap:
    """The explorer's stored map; without one, a map built from the frames' true depth.

    Raises:
        DeuxError: a file is damaged.
    """
    kept = sequence.folder / "map.npz"
    if not kept.exists():
        built = _true_map(sequence, camera, robot)
        return ExplorerMap(built.frame, built.cells)
    arrays = read_arrays(kept)
    try:
        occupancy = arrays["occupancy"]
        return ExplorerMap(stored_grid(arrays, occupancy), occupancy, arrays.get("uncertainty"))
    except (ValueError, KeyError) as error:
        raise DeuxError(f"{kept} is damaged, it holds no explorer's map ({error_text(error)}): delete it.") from error


def mean_uncertainty(episodes: Iterable[SequencePaths]) -> float | None:
    """Mean of Eq. 8 over all frames that have a value; None without any."""
    values: list[float] = []
    for sequence in episodes:
        record = sequence.folder / "uncertainty.csv"
        if record.exists():
            values += [number(row, "uncertainty", record) for row in read_table(record, "uncertainty")]
    known = np.array(values)[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def _true_map(sequence: SequencePaths, camera: Camera, robot: Robot) -> OccupancyMap:
    built = OccupancyMap(camera, robot)
    for name, pose in zip(sequence.frames(), episode_poses(sequence), strict=True):
        built.update(read_depth(sequence.file("ground_truth", name)), pose)
    return built
