"""Scorecard of a dataset: what its frames can teach an unsupervised depth model, without training one.

Everything follows from the true depth, the poses and the intrinsics of the frames that the list files name; nothing in
the dataset's folder is changed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from deux.contracts import FrameReference, Reader, Triplet
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
"""A dataset's scorecard, in the folder of the run that collected it or trained on it."""

PARALLAX = SourceRule()
"""How far apart two cameras stand, and how little they are turned, for useful parallax."""

DEPTH_CHANGE = 0.1
"""The relative change of depth whose effect on a source frame is measured."""

LEAST_SHIFT = 0.25
"""Pixels by which a change of depth must move a point in a source frame for images to tell of it."""

PLACE_SIZE = 0.5
"""Edge of a place, a square cell of the floor plan, in metres."""

VIEW_ANGLE = 30.0
"""Degrees of heading that make one view of a place."""

NEAR, FAR = 1.0, 3.0
"""Metres: nearer pixels are near, farther ones far, those between them middle."""

_LARGEST = 1e18  # of an entry
_OPTIONAL = ("depth_distance", "bumps", "actions", "area", "floor_share", "area_per_action")
"""Entries that not every dataset has."""

_BINS = np.geomspace(0.1, 20.0, 33)
"""Edges of the bins of depth, in metres; equally wide in the logarithm."""

DepthHistogram = np.ndarray
"""Shares of the pixels in each bin of depth, summing to 1."""


@dataclass(frozen=True)
class Scorecard:
    """What a dataset's frames can teach; shares are between 0 and 1.

    Args:
        frames: target frames, those that the list files name.
        sampled: of these, how many the shares of pixels are measured on.
        parallax: share of the target frames with a source frame that fulfils `PARALLAX`.
        moved: share of the pixels with true depth that `moved_share` counts, mean over the sampled frames.
        places: distinct cells of `PLACE_SIZE` of a scene in which a target's camera stands.
        views: distinct pairs of a place and a heading in steps of `VIEW_ANGLE`.
        near: share of the pixels nearer than `NEAR`.
        middle: share of the pixels between `NEAR` and `FAR`.
        far: share of the pixels at `FAR` or beyond.
        depth_distance: total variation between the histograms of depth of these frames and of the test frames, 0 to 1;
            None where there are no test frames to compare with.
        test_shares: the shares near, middle and far of the test frames' pixels; empty where there are none.
        sources: which source frames the frames are judged with: those that the model is trained with. Scorecards of
            earlier versions do not say so; they judge t-1 and t-2.
        bumps, actions, area, floor_share, area_per_action: as of `deux.metrics.explored_places.ExploredPlaces`; None
            of recorded frames too.
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
        """All numbers of the frames themselves, by their names."""
        return {name: value for name, value in asdict(self).items() if name not in ("test_shares", "sources")}

    def save(self, folder: Path) -> Path:
        """Write `scorecard.json` into a run folder, whole or not at all."""
        path = folder / SCORECARD_FILE
        write_json(path, asdict(self))
        return path

    @classmethod
    def load(cls, folder: Path) -> "Scorecard":
        """Read a run folder's `scorecard.json`.

        Raises:
            DeuxError: it is missing or not what `save` writes.
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
            raise DeuxError(f"{path} is no scorecard of deux ({error}); collect or run it again.") from None

    def table(self, caption: str) -> ResultTable:
        """The scorecard as a table, an entry a row; the test frames' shares of depth stand beside the dataset's own.

        Args:
            caption: what was scored.
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
        reader: reads the dataset.
        split: which of its splits.
        choice: how the source frames are chosen that the frames are judged with.
        simulation: the camera and the robot of a dataset that was collected here; None for recorded frames, of which
            no actions and no area are known.
        tests: reads a dataset whose "test" split the depths are compared with; None for no comparison.
        most_frames: frames at most, evenly spread over the list, on which shares of pixels are measured.

    Raises:
        DeuxError: the split is empty, or a frame has no true depth or no pose.
    """
    triplets = list_triplets(reader, split, choice)
    if not triplets:
        raise DeuxError(f"{reader.folder} lists no {split} frames, so that it has no scorecard.")
    poses = {frame: _pose(reader, frame) for one in triplets for frame in (one.target, *one.sources)}
    parallax = [any(PARALLAX.apart(poses[one.target], poses[frame]) for frame in one.sources) for one in triplets]
    sampled = evenly_chosen(triplets, most_frames)
    depths = [_depth(reader, one.target) for one in sampled]
    moved = [
        moved_share(depth, reader.intrinsics(one.target), [_motion(poses, one, frame) for frame in one.sources])
        for one, depth in zip(sampled, depths, strict=True)
    ]
    places = [(reader.place(one.target), *_place(poses[one.target])) for one in triplets]
    views = {(place, _heading(poses[one.target])) for place, one in zip(places, triplets, strict=True)}
    shares, distance, test_shares = depth_shares(depths), None, {}
    if tests is not None:
        others = [
            _depth(tests, one.target) for one in evenly_chosen(tests.triplets("test", PAPER_OFFSETS), most_frames)
        ]
        distance = total_variation(depth_histogram(depths), depth_histogram(others))
        test_shares = depth_shares(others)
    explored: dict[str, Any] = {}
    if simulation is not None:
        explored = asdict(measure_explored_places(reader.folder, simulation.camera, simulation.robot))
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
        depth_distance=distance,
        test_shares=test_shares,
        sources=choice,
        **explored,
    )


def moved_share(depth: np.ndarray, intrinsics: np.ndarray, motions: Sequence[np.ndarray]) -> float:
    """Share of the pixels at which an error of depth shows in some source frame.

    A pixel u of depth z lies at pi(K T z K^-1 u) in a source frame. It counts where (1 + `DEPTH_CHANGE`) z moves that
    point by `LEAST_SHIFT` pixels or more, and the point lies inside the source frame. Occlusion is not checked.

    Args:
        depth: H x W metres; 0 where there is none.
        intrinsics: 3 x 3, of both cameras.
        motions: 4 x 4 each, from the target camera to a source camera.

    Returns:
        The share of the pixels with depth; NaN where there is none.
    """
    rows, columns = np.nonzero(depth > 0)
    if not rows.size:
        return float("nan")
    rays = np.linalg.inv(intrinsics) @ np.stack([columns, rows, np.ones_like(rows)]).astype(float)
    points = rays * depth[rows, columns]
    counted = np.zeros(rows.size, bool)
    for matrix in motions:
        here, there = (_project(intrinsics, matrix, points * scale) for scale in (1.0, 1.0 + DEPTH_CHANGE))
        limits = np.array([[depth.shape[1] - 0.5], [depth.shape[0] - 0.5]])
        with np.errstate(invalid="ignore"):
            inside = np.all((here >= -0.5) & (here <= limits), axis=0)
            counted |= inside & (np.linalg.norm(there - here, axis=0) >= LEAST_SHIFT)
    return float(counted.mean())


def depth_shares(depths: Sequence[np.ndarray]) -> dict[str, float]:
    """Shares of the pixels with depth that are near, middle and far; all 0 where no pixel has depth."""
    known = np.concatenate([depth[depth > 0].ravel() for depth in depths]) if depths else np.zeros(0)
    count = max(1, known.size)
    near, far = float((known < NEAR).sum() / count), float((known >= FAR).sum() / count)
    return {"near": near, "middle": known.size / count - near - far, "far": far}


def depth_histogram(depths: Sequence[np.ndarray]) -> DepthHistogram:
    """Shares of the pixels with depth in bins that are equally wide in log depth; depths beyond count at the ends."""
    known = np.concatenate([depth[depth > 0].ravel() for depth in depths]) if depths else np.zeros(0)
    counts, _ = np.histogram(np.clip(known, _BINS[0], _BINS[-1]), _BINS)
    return counts / max(1, known.size)


def total_variation(first: DepthHistogram, second: DepthHistogram) -> float:
    """Total variation distance, half the sum of |p - q| over all bins: 0 for equal histograms, 1 for disjoint ones."""
    return float(np.abs(first - second).sum() / 2.0)


def _project(intrinsics: np.ndarray, matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixel coordinates, 2 x N, of points (3 x N, target camera) in a source frame; NaN behind the camera."""
    seen = intrinsics @ (matrix[:3, :3] @ points + matrix[:3, 3:])
    return seen[:2] / np.where(seen[2] > 1e-6, seen[2], np.nan)


def _motion(poses: Mapping[FrameReference, np.ndarray], triplet: Triplet, source: FrameReference) -> np.ndarray:
    return source_from_target(poses[triplet.target], poses[source])


def _place(pose: np.ndarray) -> tuple[int, int]:
    return int(np.floor(pose[0, 3] / PLACE_SIZE)), int(np.floor(pose[2, 3] / PLACE_SIZE))


def _heading(pose: np.ndarray) -> int:
    """Number of the heading's sector; sectors are centred on the multiples of `VIEW_ANGLE`."""
    return round(np.degrees(yaw_of(pose)) / VIEW_ANGLE) % round(360.0 / VIEW_ANGLE)


def _pose(reader: Reader, frame: FrameReference) -> np.ndarray:
    pose = reader.pose(frame)
    if pose is None:
        raise DeuxError(f"Frame {frame} of {reader.folder} has no pose, which the scorecard needs.")
    return pose


def _depth(reader: Reader, frame: FrameReference) -> np.ndarray:
    depth = reader.ground_truth(frame)
    if depth is None:
        raise DeuxError(f"Frame {frame} of {reader.folder} has no true depth, which the scorecard needs.")
    return depth
