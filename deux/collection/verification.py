"""Stage 3: frames that a depth model cannot learn from, or be judged by, are rejected and the reason is kept."""

import json
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from enum import StrEnum

import numpy as np

from deux.collection.sparse import SparseSettings, point_count
from deux.errors import DeuxError, check_range
from deux.geometry.poses import motion
from deux.io.atomic import write_json
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.images import read_depth, read_image
from deux.io.layout import SequencePaths, neighbours
from deux.io.progress import Progress, ignore_progress


class Rejection(StrEnum):
    """Why a frame is no target."""

    UNREADABLE = "unreadable"
    INCONSISTENT = "inconsistent"
    TOO_FEW_POINTS = "too_few_points"
    TOO_LITTLE_DEPTH = "too_little_depth"
    NO_MOTION = "no_motion"
    ONE_COLOR = "one_color"


@dataclass(frozen=True)
class VerificationSettings:
    """What a frame must have.

    Args:
        min_points: least number of sparse points, as a fraction of those asked for (the published NYUv2 set-up
            asks 1,100 of 1,500).
        min_depth: least fraction of pixels with ground truth; not checked where a dataset has no ground truth.
        min_distance: metres that the camera must have moved since one of the source frames, or
        min_angle: degrees that it must have turned.

    Raises:
        DeuxError: a value is out of its range.
    """

    min_points: float = 0.73
    min_depth: float = 0.3
    min_distance: float = 0.01
    min_angle: float = 1.0

    def __post_init__(self) -> None:
        check_range("verification.min_points", self.min_points, 0, 1)
        check_range("verification.min_depth", self.min_depth, 0, 1)
        check_range("verification.min_distance", self.min_distance, 0)
        check_range("verification.min_angle", self.min_angle, 0)


@dataclass(frozen=True)
class _Checked:
    """What was found of one frame by itself; no pose if it could not be read."""

    rejection: Rejection | None
    pose: np.ndarray | None = None


def verify_sequences(
    found: Sequence[SequencePaths],
    settings: VerificationSettings,
    sparse: SparseSettings,
    offsets: tuple[int, ...] = (-1, -2),
    progress: Progress = ignore_progress,
) -> dict[str, dict[str, Rejection | None]]:
    """Judge every frame that has all its source frames, and note the result in the sequence's `verification.json`.

    A sequence that was judged before by the same settings is not read again.

    Args:
        found: the sequences.
        settings: what a frame must have.
        sparse: how many sparse points were asked for.
        offsets: the source frames, in frames from the target.
        progress: told the number of sequences.

    Returns:
        For each sequence's name, for each target frame in the order of time: why it is rejected, or None.
    """
    verdicts = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # decoding releases the interpreter's lock
        for done, paths in enumerate(found, start=1):
            verdicts[paths.name] = _verify_sequence(paths, settings, sparse, offsets, pool)
            progress("verification", done, len(found))
    return verdicts


def _verify_sequence(
    paths: SequencePaths,
    settings: VerificationSettings,
    sparse: SparseSettings,
    offsets: tuple[int, ...],
    pool: ThreadPoolExecutor,
) -> dict[str, Rejection | None]:
    record = paths.folder / "verification.json"
    made_by = {"settings": asdict(settings), "sparse": asdict(sparse), "offsets": list(offsets)}
    if record.exists():
        earlier = json.loads(record.read_text())
        if earlier["made_by"] == made_by:
            return {name: Rejection(reason) if reason else None for name, reason in earlier["frames"].items()}
    frames = paths.frames()
    if _has_intrinsics(paths):
        results = pool.map(lambda name: _check(paths, name, settings, sparse), frames)
        checked = dict(zip(frames, results, strict=True))
    else:
        checked = dict.fromkeys(frames, _Checked(Rejection.INCONSISTENT))
    verdict = {
        triplet[0]: _judge([checked[name] for name in triplet], settings) for triplet in neighbours(frames, offsets)
    }
    write_json(record, {"made_by": made_by, "frames": verdict})
    return verdict


def _has_intrinsics(paths: SequencePaths) -> bool:
    try:
        read_intrinsics(paths.intrinsics)
    except DeuxError:
        return False
    return True


def _check(paths: SequencePaths, name: str, settings: VerificationSettings, sparse: SparseSettings) -> _Checked:
    """Judge one frame by itself."""
    files = {kind: paths.file(kind, name) for kind in ("image", "sparse_depth", "validity_map", "ground_truth")}
    if not (paths.folder / "ground_truth").is_dir():
        del files["ground_truth"]
    pose_file = paths.file("absolute_pose", name)
    if not all(file.exists() for file in (*files.values(), pose_file)):
        return _Checked(Rejection.INCONSISTENT)
    try:
        image, pose = read_image(files.pop("image")), read_pose(pose_file)
        maps = {kind: read_depth(file) for kind, file in files.items()}
    except DeuxError:
        return _Checked(Rejection.UNREADABLE)
    points = maps["sparse_depth"] > 0
    if any(depth.shape != image.shape[:2] for depth in maps.values()) or (points != (maps["validity_map"] > 0)).any():
        return _Checked(Rejection.INCONSISTENT)
    if (image == image[0, 0]).all():  # no photometric error tells one depth from another
        return _Checked(Rejection.ONE_COLOR, pose)
    if points.sum() < settings.min_points * point_count(points.shape, sparse):
        return _Checked(Rejection.TOO_FEW_POINTS, pose)
    if "ground_truth" in maps and np.mean(maps["ground_truth"] > 0) < settings.min_depth:
        return _Checked(Rejection.TOO_LITTLE_DEPTH, pose)
    return _Checked(None, pose)


def _judge(triplet: Sequence[_Checked], settings: VerificationSettings) -> Rejection | None:
    """Judge a target (first) together with its source frames, of which only image and pose are used."""
    for frame in triplet:
        if frame.pose is None:
            return frame.rejection
    if triplet[0].rejection:
        return triplet[0].rejection
    target, *sources = (frame.pose for frame in triplet if frame.pose is not None)
    moved = [
        distance >= settings.min_distance or angle >= settings.min_angle
        for distance, angle in (motion(target, source) for source in sources)
    ]
    return None if any(moved) else Rejection.NO_MOTION
