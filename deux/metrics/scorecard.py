"""Scorecard of a dataset: statistics that show how useful it is for unsupervised depth learning.

All statistics are computed from the ground truth, poses and intrinsics of the frames in the list files. The dataset is
not changed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from deux.contracts import FrameReference, Reader, Triplet
from deux.data.checked_frames import ground_truth_of, intrinsics_of, pose_of
from deux.data.chosen_sources import PAPER_OFFSETS, list_triplets
from deux.data.even_choice import evenly_chosen
from deux.errors import DeuxError, shown
from deux.geometry.poses import source_from_target, yaw_of
from deux.geometry.source_frames import SourceRule
from deux.io.atomic import write_json
from deux.io.json_files import read_record
from deux.io.layout import SourceChoice
from deux.metrics.explored_places import measure_explored_places
from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, Column, ResultTable, Row
from deux.simulator.simulation import Simulation

SCORECARD_FILE = "scorecard.json"
"""File name of a scorecard, in the folder of the run that collected the dataset or trained on it."""

PARALLAX = SourceRule()
"""Distance and rotation between two cameras for useful parallax."""

DEPTH_CHANGE = 0.1
"""Relative change of depth whose effect on a source frame is measured."""

LEAST_SHIFT = 0.25
"""Minimum shift in a source frame, in pixels, for a change of depth to be visible."""

PLACE_SIZE = 0.5
"""Edge length of a place, a square cell of the floor plan, in metres."""

VIEW_ANGLE = 30.0
"""Angular size of a view, in degrees of heading."""

NEAR, FAR = 1.0, 3.0
"""Limits of the depth classes near, middle and far, in metres."""

_LARGEST = 1e18  # limit for entries read from a file
_OPTIONAL = ("depth_distance", "bumps", "actions", "area", "floor_share", "area_per_action")
"""Entries that may be None."""

_BINS = np.geomspace(0.1, 20.0, 33)
"""Edges of the depth bins in metres, logarithmically spaced."""

DepthHistogram = np.ndarray
"""Fraction of the pixels in each depth bin; the sum is 1."""


@dataclass(frozen=True)
class Scorecard:
    """Statistics of a dataset; shares are between 0 and 1.

    Args:
        frames: number of target frames in the list files.
        sampled: number of target frames on which the pixel shares are measured.
        parallax: share of target frames with a source frame that satisfies `PARALLAX`.
        moved: share of pixels with ground truth for which a depth error is visible (`moved_share`), mean over the
            sampled frames.
        places: number of distinct cells of `PLACE_SIZE` that contain a target camera.
        views: number of distinct pairs of a place and a heading in steps of `VIEW_ANGLE`.
        near: share of pixels nearer than `NEAR`.
        middle: share of pixels between `NEAR` and `FAR`.
        far: share of pixels at `FAR` or beyond.
        depth_distance: total variation distance between the depth histograms of these frames and of the test frames,
            0 to 1; None without test frames.
        test_shares: the shares near, middle and far of the test frames; empty without test frames.
        sources: selection of the source frames, which should be that of the training. Scorecards of earlier versions
            have no such entry; they use t-1 and t-2.
        bumps, actions, area, floor_share, area_per_action: see `deux.metrics.explored_places.ExploredPlaces`; None for
            recorded frames.
    """

    frames: int
    sampled: int
    parallax: float
    moved: float
    places: int
    views: int
    near: float
    middle: float
    far: float
    depth_distance: float | None = None
    test_shares: Mapping[str, float] = field(default_factory=dict)
    sources: SourceChoice = "recent"
    bumps: float | None = None
    actions: int | None = None
    area: float | None = None
    floor_share: float | None = None
    area_per_action: float | None = None

    def entries(self) -> dict[str, float | None]:
        """The statistics of the frames by name, without those of the test frames."""
        return {name: value for name, value in asdict(self).items() if name not in ("test_shares", "sources")}

    def save(self, folder: Path) -> Path:
        """Write `scorecard.json` into a run folder atomically."""
        path = folder / SCORECARD_FILE
        write_json(path, asdict(self))
        return path

    @classmethod
    def load(cls, folder: Path) -> "Scorecard":
        """Read a run folder's `scorecard.json`.

        Raises:
            DeuxError: the file is missing or not a valid scorecard.
        """
        path = folder / SCORECARD_FILE
        try:
            card = read_record(path, cls)
            for name, value in card.entries().items():
                if type(value) not in (int, float) and (value is not None or name not in _OPTIONAL):
                    raise ValueError(f"{name} is {shown(value)}")
                if value is not None and abs(value) > _LARGEST:
                    raise ValueError(f"{name} is {shown(value)}")
            return card
        except (DeuxError, ValueError) as error:
            raise DeuxError(f"{path} is not a scorecard of deux ({error}); collect or run it again.") from None

    def table(self, caption: str) -> ResultTable:
        """The scorecard as a table with a row for each entry and a column for the depth shares of the test frames.

        Args:
            caption: caption of the table.
        """
        columns = (Column("value", digits=3), Column("test frames", digits=3))
        rows = []
        for name, value in self.entries().items():
            if value is not None:
                numbers = (value, self.test_shares.get(name))
                digits = 0 if isinstance(value, int) else None  # counts are whole numbers
                cells = tuple(Cell(None if n is None else Estimate(n, math.nan), digits=digits) for n in numbers)
                rows.append(Row((name.replace("_", " "),), cells))
        notes = (f"sources: {self.sources}",)
        return ResultTable(caption, ("entry",), columns, (tuple(rows),), name="scorecard", notes=notes)


def score(
    reader: Reader,
    split: str = "train",
    choice: SourceChoice = "recent",
    tests: Reader | None = None,
    simulation: Simulation | None = None,
    most_frames: int = 50,
) -> Scorecard:
    """Compute the scorecard of one split of a dataset.

    Args:
        reader: reader of the dataset.
        split: name of the split.
        choice: selection of the source frames.
        tests: reader of the dataset whose "test" split the depths are compared with; None for no comparison.
        simulation: camera and robot of a collected dataset; None for recorded frames, which have no actions.
        most_frames: maximum number of frames, evenly spread over the list, on which pixel shares are measured.

    Raises:
        DeuxError: the split is empty, or a frame has no ground truth or no pose.
    """
    triplets = list_triplets(reader, split, choice)
    if not triplets:
        raise DeuxError(f"{reader.folder} lists no {split} frames, which the scorecard needs.")
    poses = {frame: _pose(reader, frame) for one in triplets for frame in (one.target, *one.sources)}
    parallax = [any(PARALLAX.apart(poses[one.target], poses[frame]) for frame in one.sources) for one in triplets]
    sampled = evenly_chosen(triplets, most_frames)
    depths = [_depth(reader, one.target) for one in sampled]
    moved = [
        moved_share(depth, intrinsics_of(reader, one.target), [_motion(poses, one, frame) for frame in one.sources])
        for one, depth in zip(sampled, depths, strict=True)
    ]
    places = [(reader.place(one.target), *_place(poses[one.target])) for one in triplets]
    views = {(place, _heading(poses[one.target])) for place, one in zip(places, triplets, strict=True)}
    shares, optional = depth_shares(depths), dict[str, Any]()
    if tests is not None:
        test_triplets = evenly_chosen(tests.triplets("test", PAPER_OFFSETS), most_frames)
        test_depths = [_depth(tests, one.target) for one in test_triplets]
        optional["depth_distance"] = total_variation(depth_histogram(depths), depth_histogram(test_depths))
        optional["test_shares"] = depth_shares(test_depths)
    if simulation is not None:
        optional |= asdict(measure_explored_places(reader.folder, simulation.camera, simulation.robot))
    return Scorecard(
        frames=len(triplets),
        sampled=len(sampled),
        parallax=float(np.mean(parallax)),
        moved=float(np.nanmean(moved)) if not np.all(np.isnan(moved)) else 0.0,
        places=len(set(places)),
        views=len(views),
        near=shares["near"],
        middle=shares["middle"],
        far=shares["far"],
        sources=choice,
        **optional,
    )


def moved_share(depth: np.ndarray, intrinsics: np.ndarray, motions: Sequence[np.ndarray]) -> float:
    """Share of the pixels at which a depth error is visible in at least one source frame.

    A pixel u with depth z projects to pi(K T z K^-1 u) in a source frame. It counts if a depth of
    (1 + `DEPTH_CHANGE`) z shifts the projection by `LEAST_SHIFT` pixels or more, and the projection lies inside the
    source frame. Occlusion is ignored.

    Args:
        depth: H x W metres, 0 = none.
        intrinsics: 3 x 3, of both cameras.
        motions: 4 x 4 transforms from the target camera to each source camera.

    Returns:
        The share of the pixels with depth; NaN if no pixel has depth.
    """
    rows, columns = np.nonzero(depth > 0)
    if not rows.size:
        return float("nan")
    rays = np.linalg.inv(intrinsics) @ np.stack([columns, rows, np.ones_like(rows)]).astype(float)
    points = rays * depth[rows, columns]
    moved = np.zeros(rows.size, bool)
    for matrix in motions:
        original, shifted = (_project(intrinsics, matrix, points * scale) for scale in (1.0, 1.0 + DEPTH_CHANGE))
        limits = np.array([[depth.shape[1] - 0.5], [depth.shape[0] - 0.5]])
        with np.errstate(invalid="ignore"):
            inside = np.all((original >= -0.5) & (original <= limits), axis=0)
            moved |= inside & (np.linalg.norm(shifted - original, axis=0) >= LEAST_SHIFT)
    return float(moved.mean())


def depth_shares(depths: Sequence[np.ndarray]) -> dict[str, float]:
    """Shares of the pixels with depth that are near, middle and far; all 0 if no pixel has depth."""
    known = np.concatenate([depth[depth > 0].ravel() for depth in depths]) if depths else np.zeros(0)
    count = max(1, known.size)
    near, far = float((known < NEAR).sum() / count), float((known >= FAR).sum() / count)
    return {"near": near, "middle": known.size / count - near - far, "far": far}


def depth_histogram(depths: Sequence[np.ndarray]) -> DepthHistogram:
    """Histogram of the valid depths in logarithmic bins; depths outside of the bins count in the outermost ones."""
    known = np.concatenate([depth[depth > 0].ravel() for depth in depths]) if depths else np.zeros(0)
    counts, _ = np.histogram(np.clip(known, _BINS[0], _BINS[-1]), _BINS)
    return counts / max(1, known.size)


def total_variation(first: DepthHistogram, second: DepthHistogram) -> float:
    """Total variation distance, half the sum of |p - q| over all bins; 0 for equal and 1 for disjoint histograms."""
    return float(np.abs(first - second).sum() / 2.0)


def _project(intrinsics: np.ndarray, matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixel coordinates, 2 x N, of points (3 x N, target camera) in a source frame; NaN behind the camera."""
    projected = intrinsics @ (matrix[:3, :3] @ points + matrix[:3, 3:])
    return projected[:2] / np.where(projected[2] > 1e-6, projected[2], np.nan)


def _motion(poses: Mapping[FrameReference, np.ndarray], triplet: Triplet, source: FrameReference) -> np.ndarray:
    return source_from_target(poses[triplet.target], poses[source])


def _place(pose: np.ndarray) -> tuple[int, int]:
    return int(np.floor(pose[0, 3] / PLACE_SIZE)), int(np.floor(pose[2, 3] / PLACE_SIZE))


def _heading(pose: np.ndarray) -> int:
    """Index of the heading's sector; sectors are centred on the multiples of `VIEW_ANGLE`."""
    return round(np.degrees(yaw_of(pose)) / VIEW_ANGLE) % round(360.0 / VIEW_ANGLE)


def _pose(reader: Reader, frame: FrameReference) -> np.ndarray:
    pose = pose_of(reader, frame)
    if pose is None:
        raise DeuxError(f"Frame {frame} of {reader.folder} has no pose, which the scorecard needs.")
    return pose


def _depth(reader: Reader, frame: FrameReference) -> np.ndarray:
    depth = ground_truth_of(reader, frame)
    if depth is None:
        raise DeuxError(f"Frame {frame} of {reader.folder} has no ground truth, which the scorecard needs.")
    return depth
