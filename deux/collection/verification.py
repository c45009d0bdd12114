"""Stage 3: rejects frames that are unsuitable for training or evaluation, and stores the reason."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from deux.collection.sparse import SparseSettings, point_count
from deux.errors import DeuxError, check_range, error_text
from deux.geometry.poses import motion
from deux.geometry.source_frames import SourceRule, SourceView, choose_sources, has_parallax
from deux.io.atomic import write_json
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.images import read_depth, read_image
from deux.io.json_files import checked_record, read_json_object
from deux.io.layout import SequencePaths, SourceChoice, neighbours
from deux.io.progress import Progress, ignore_progress
from deux.options import converted


class Rejection(StrEnum):
    """Why a frame is rejected as a target."""

    UNREADABLE = "unreadable"
    INCONSISTENT = "inconsistent"
    TOO_FEW_POINTS = "too_few_points"
    TOO_LITTLE_DEPTH = "too_little_depth"
    NO_MOTION = "no_motion"
    ONE_COLOR = "one_color"


@dataclass(frozen=True)
class VerificationSettings:
    """The requirements on a target frame.

    Args:
        min_points: least number of sparse points, as a fraction of the requested number (the published NYUv2 setup
            requires 1,100 of 1,500).
        min_depth: least fraction of pixels with ground truth; not checked without ground truth.
        min_distance: least distance in metres to one of the source frames, unless
        min_angle: the camera has turned by at least this angle in degrees since that frame.

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


class Verdict(NamedTuple):
    """The verdict on a target, with its source frames.

    Args:
        sources: names of its source frames.
        rejection: why it is rejected, or None.
        parallax: whether a source frame satisfies `deux.geometry.source_frames.SourceRule`.
    """

    sources: tuple[str, ...]
    rejection: Rejection | None
    parallax: bool


Verdicts = Mapping[SourceChoice, Mapping[str, Verdict]]
"""The verdicts on a sequence's targets by name, in the order of time, for each choice of source frames."""


_RECENT = (-1, -2)
"""The recent source frames, in frames from the target."""


@dataclass(frozen=True)
class _Checked:
    """The result of checking one frame by itself; without a view if it could not be read."""

    rejection: Rejection | None
    view: SourceView | None = None


def verify_sequences(
    found: Sequence[SequencePaths],
    settings: VerificationSettings,
    sparse: SparseSettings,
    every_frame: bool = True,
    progress: Progress = ignore_progress,
) -> dict[str, Verdicts]:
    """Verify every frame with its source frames, and store the verdicts in the sequence's `verification.json`.

    Each frame is verified twice: "recent" by t-1 and t-2, if both exist, and "baseline" by the source frames that
    `deux.geometry.source_frames` chooses around it. Sequences with verdicts for the same settings are not read
    again.

    Args:
        found: the sequences.
        settings: requirements on a frame.
        sparse: requested number of sparse points.
        every_frame: whether frames without recent source frames can be targets by baseline; false for viewpoints, whose
            first frames serve only as source frames.
        progress: called with the number of sequences.

    Returns:
        The verdicts of each sequence, by its name.
    """
    verdicts: dict[str, Verdicts] = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # decoding releases the GIL
        for done, paths in enumerate(found, start=1):
            verdicts[paths.name] = _verify_sequence(paths, settings, sparse, every_frame, pool)
            progress("verification", done, len(found))
    return verdicts


def _verify_sequence(
    paths: SequencePaths,
    settings: VerificationSettings,
    sparse: SparseSettings,
    every_frame: bool,
    pool: ThreadPoolExecutor,
) -> Verdicts:
    record, rule = paths.folder / "verification.json", SourceRule()
    made_by = {"settings": asdict(settings), "sparse": asdict(sparse), "offsets": list(_RECENT), "rule": asdict(rule)}
    if record.exists():
        earlier = read_json_object(record)
        if earlier.get("made_by") == made_by:
            return _read_verdicts(earlier.get("frames"), record)
    frames = paths.frames()
    try:
        intrinsics = read_intrinsics(paths.intrinsics)
    except DeuxError:
        checked = dict.fromkeys(frames, _Checked(Rejection.INCONSISTENT))
    else:
        results = pool.map(lambda name: _check(paths, name, intrinsics, settings, sparse), frames)
        checked = dict(zip(frames, results, strict=True))
    recent = {target: tuple(sources) for target, *sources in neighbours(frames, _RECENT)}
    chosen = _choose(frames, checked, rule, frames if every_frame else list(recent))
    verdicts: Verdicts = {
        "recent": {target: _verdict(target, sources, checked, settings, rule) for target, sources in recent.items()},
        "baseline": {target: _verdict(target, sources, checked, settings, rule) for target, sources in chosen.items()},
    }
    stored = {choice: {name: one._asdict() for name, one in targets.items()} for choice, targets in verdicts.items()}
    write_json(record, {"made_by": made_by, "frames": stored})
    return verdicts


def _read_verdicts(stored: Any, record: Path) -> Verdicts:
    """Parse the verdicts of a `verification.json`."""
    kept = checked_record(stored, dict[str, dict[str, dict[str, Any]]], record)

    def verdict(one: Mapping[str, Any]) -> Verdict:
        rejection = Rejection(one["rejection"]) if one["rejection"] else None
        return Verdict(converted(one["sources"], tuple[str, ...], "sources"), rejection, bool(one["parallax"]))

    try:
        return {choice: {name: verdict(one) for name, one in kept[choice].items()} for choice in ("recent", "baseline")}
    except (DeuxError, KeyError, ValueError, TypeError) as error:
        raise DeuxError(f"{record} is damaged, it holds no verdicts ({error_text(error)}): delete it.") from error


def _choose(
    frames: Sequence[str], checked: Mapping[str, _Checked], rule: SourceRule, targets: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """The source frames by baseline of each target for which suitable frames exist."""
    place = {name: number for number, name in enumerate(frames)}
    chosen: dict[str, tuple[str, ...]] = {}
    for name in targets:
        view, around = checked[name].view, {}
        for step in (step for step in range(-rule.reach, rule.reach + 1) if step):
            if 0 <= place[name] + step < len(frames):
                other = checked[frames[place[name] + step]]
                if other.view is not None and other.rejection != Rejection.ONE_COLOR:
                    around[step] = other.view
        if view is None:
            chosen[name] = ()
        elif steps := choose_sources(view, around, rule).steps:
            chosen[name] = tuple(frames[place[name] + step] for step in steps)
    return chosen


def _check(
    paths: SequencePaths, name: str, intrinsics: np.ndarray, settings: VerificationSettings, sparse: SparseSettings
) -> _Checked:
    """Check one frame by itself."""
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
    view = SourceView.of(pose, intrinsics, maps["sparse_depth"])
    if (image == image[0, 0]).all():  # the photometric error is the same for any depth
        return _Checked(Rejection.ONE_COLOR, view)
    if points.sum() < settings.min_points * point_count(points.shape, sparse):
        return _Checked(Rejection.TOO_FEW_POINTS, view)
    if "ground_truth" in maps and np.mean(maps["ground_truth"] > 0) < settings.min_depth:
        return _Checked(Rejection.TOO_LITTLE_DEPTH, view)
    return _Checked(None, view)


def _verdict(
    target: str,
    sources: tuple[str, ...],
    checked: Mapping[str, _Checked],
    settings: VerificationSettings,
    rule: SourceRule,
) -> Verdict:
    """Verify a target with its source frames, of which only image, pose and points are used."""
    views = []
    for name in (target, *sources):
        view = checked[name].view
        if view is None:
            return Verdict(sources, checked[name].rejection, False)
        views.append(view)
    rejection = checked[target].rejection
    if rejection is None:
        moved = (motion(views[0].pose, source.pose) for source in views[1:])
        if not any(d >= settings.min_distance or angle >= settings.min_angle for d, angle in moved):
            rejection = Rejection.NO_MOTION
    return Verdict(sources, rejection, has_parallax(views[0], views[1:], rule))
