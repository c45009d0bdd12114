"""What a stored episode explored: its explorer's own map, or one made from its frames."""

from collections.abc import Iterable

import numpy as np

from deux.collection.free_floor import stored_grid
from deux.contracts import ExplorerMap, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.arrays import read_arrays, said
from deux.io.calibration import read_pose
from deux.io.csv_files import number, read_table
from deux.io.images import read_depth
from deux.io.layout import SequencePaths
from deux.mapping.occupancy import OccupancyMap


def episode_poses(sequence: SequencePaths) -> np.ndarray:
    """Camera-to-world matrices of an episode's frames, N x 4 x 4, in order of time."""
    return np.stack([read_pose(sequence.file("absolute_pose", frame)) for frame in sequence.frames()])


def explored_map(sequence: SequencePaths, camera: Camera, robot: Robot) -> ExplorerMap:
    """The map that the explorer kept; where it kept none, one built from the frames' true depth.

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
        raise DeuxError(f"{kept} is damaged, it holds no explorer's map ({said(error)}): delete it.") from error


def mean_uncertainty(episodes: Iterable[SequencePaths]) -> float | None:
    """Mean of Eq. 8 over all frames that have one; None where the explorers were shown none."""
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
