"""Checks of recorded frames, split by split: cameras, depth, poses, and their consistency."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, MissingSplit, Reader, Triplet
from deux.contracts.reader import SPLITS
from deux.data.checked_frames import ground_truth_of, image_of, intrinsics_of, pose_of, sparse_depth_of, triplets_of
from deux.data.chosen_sources import count_without_sources
from deux.data.depth_unit import points_scale, ratio_remedy, ratio_warning, unit_warning
from deux.data.even_choice import evenly_chosen
from deux.doctor.true_depth_warp import FramePair, WarpErrors, warp, warp_errors
from deux.errors import counted, plural
from deux.figures.drawing import save_figure
from deux.figures.frame_preview import PreviewFrame, draw_preview
from deux.geometry.poses import motion
from deux.io.calibration import camera_warning
from deux.io.layout import SourceChoice

CHECKED = 12
"""Number of frames of a split that are read, spread evenly."""

PREVIEWED = 3
"""Number of frames of a split in the preview."""

RANGE = (0.1, 10.0)
"""Depth range of indoor scenes in metres; the defaults of `camera.min_depth` and `camera.max_depth`."""


@dataclass
class SplitCheck:
    """The results for one split.

    Args:
        split: "train", "validation" or "test".
        frames: number of target frames; 0 if the folder has no such split.
        facts: results, a line each.
        problems: probable faults, a sentence each.
        warp: warp error of the true depth; None without poses, ground truth or neighbouring frames.
        preview: file of the preview; None if none was drawn.
    """

    split: str
    frames: int = 0
    facts: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    warp: WarpErrors | None = None
    preview: Path | None = None


def check_frames(
    reader: Reader,
    offsets: tuple[int, ...] = (-1, -2),
    previews: Path | None = None,
    depth_range: tuple[float, float] = RANGE,
    show: Callable[[str], None] = print,
    choice: SourceChoice = "recent",
) -> list[SplitCheck]:
    """Read some frames of each split and check them.

    Args:
        reader: reader of the recorded frames.
        offsets: offsets of the source frames from the target, if the folder does not list source frames.
        previews: folder of a preview of each split, `<split>.png`; None for no previews.
        depth_range: nearest and farthest depth of the scenes in metres, for checking the unit of depth.
        show: called with each line of the results.
        choice: how source frames are chosen for training.

    Returns:
        The results for each split, including missing ones.

    Raises:
        DeuxError: a file of a frame is missing, damaged or of the wrong type.
    """
    checks = []
    for split in SPLITS:
        check = _check_split(reader, split, offsets, previews, depth_range, "recent" if split == "test" else choice)
        show(f"{split}: {counted(check.frames, 'frame')}" if check.frames else f"{split}: none")
        for line in check.facts:
            show(f"  {line}")
        for line in check.problems:
            show(f"  LOOK: {line}")
        checks.append(check)
    return checks


def _check_split(
    reader: Reader,
    split: str,
    offsets: tuple[int, ...],
    previews: Path | None,
    depth_range: tuple[float, float],
    choice: SourceChoice,
) -> SplitCheck:
    try:
        triplets = triplets_of(reader, split, offsets)
    except MissingSplit as error:
        return SplitCheck(split, facts=[str(error)])
    check = SplitCheck(split, len(triplets))
    sequences = {triplet.target.sequence for triplet in triplets}
    check.facts.append(counted(len(sequences), "sequence"))
    if single := count_without_sources(reader, split, choice, offsets):
        where = f" at {list(offsets)}" if choice == "recent" else ""
        check.facts.append(
            f"{counted(single, 'frame')} {plural('has', single)} no source frames{where}: evaluated, but not trained on"
        )
    chosen = evenly_chosen(triplets, CHECKED)
    targets = [triplet.target for triplet in chosen]
    _check_cameras(reader, targets, check)
    _check_sizes(reader, targets, check)
    _check_depth(reader, targets, depth_range, check)
    neighbours = _neighbours(reader, split)
    _check_poses(reader, neighbours, check)
    _check_warp(reader, neighbours, check)
    if previews is not None:
        rows = [_preview(reader, triplet) for triplet in evenly_chosen(neighbours or chosen, PREVIEWED)]
        check.preview = save_figure(draw_preview(rows), previews / f"{split}.png")
        check.facts.append(f"preview: {check.preview}")
    return check


def _neighbours(reader: Reader, split: str) -> list[Triplet]:
    """Targets with the frame before them, or with the first source frame that the folder lists."""
    triplets = triplets_of(reader, split, (-1,))
    pairs = [Triplet(target, sources[:1]) for target, sources in triplets if sources]
    return evenly_chosen(pairs, CHECKED) if pairs else []


def _check_cameras(reader: Reader, frames: Sequence[FrameReference], check: SplitCheck) -> None:
    """Check image size and intrinsics, once for each sequence."""
    cameras: dict[str, str] = {}
    for frame in {frame.sequence: frame for frame in frames}.values():
        height, width = image_of(reader, frame).shape[:2]
        matrix = intrinsics_of(reader, frame)
        (fx, fy), (x, y) = matrix[[0, 1], [0, 1]], matrix[:2, 2]
        views = [math.degrees(2 * math.atan(side / (2 * f))) for side, f in ((width, fx), (height, fy))]
        line = (
            f"{width} x {height} pixels; focal length {fx:.1f}, {fy:.1f}, principal point {x:.1f}, {y:.1f}; field of "
            f"view {views[0]:.0f} x {views[1]:.0f} degrees"
        )
        cameras.setdefault(line, frame.sequence)
        if warning := camera_warning(matrix, height, width, f"the camera matrix of {frame.sequence}"):
            check.problems.append(warning)
    for line, sequence in cameras.items():
        check.facts.append(line if len(cameras) == 1 else f"{sequence}: {line}")


def _check_sizes(reader: Reader, frames: Sequence[FrameReference], check: SplitCheck) -> None:
    """Check that depth maps have the size of their images."""
    for kind, read in (("sparse depth", sparse_depth_of), ("ground truth", ground_truth_of)):
        mismatches = []
        for frame in frames:
            depth, image = read(reader, frame), image_of(reader, frame)
            if depth is not None and depth.shape != image.shape[:2]:
                sizes = f"{depth.shape[1]} x {depth.shape[0]} pixels and its image {image.shape[1]} x {image.shape[0]}"
                mismatches.append(f"the {kind} of frame {frame.name} of {frame.sequence} has {sizes}")
        if mismatches:
            count = f"{len(mismatches)} of the {counted(len(frames), 'frame')} that were read"
            check.problems.append(f"{mismatches[0]}: depth must be registered to the image, pixel by pixel ({count}).")


def _check_depth(
    reader: Reader, frames: Sequence[FrameReference], depth_range: tuple[float, float], check: SplitCheck
) -> None:
    """Check range, density and unit of the sparse points and the ground truth."""
    points = [sparse_depth_of(reader, frame) for frame in frames]
    truths = [truth for frame in frames if (truth := ground_truth_of(reader, frame)) is not None]
    counts = [int(np.count_nonzero(depth)) for depth in points]
    check.facts.append(
        f"{np.median(counts):.0f} sparse points a frame ({min(counts)} to {max(counts)}), {_range(points, depth_range)}"
    )
    if empty := counts.count(0):
        read = counted(len(counts), "frame")
        check.problems.append(f"{empty} of the {read} that were read {plural('has', empty)} no sparse point.")
    if truths:
        valid = np.mean([np.mean(truth > 0) for truth in truths])
        check.facts.append(f"ground truth at {valid:.0%} of the pixels, {_range(truths, depth_range)}")
    else:
        check.facts.append("no ground truth: no errors can be measured")
    scale = points_scale(reader)
    warnings = []
    if scale is not None:
        warnings.append(unit_warning(_flat(points), scale[0], depth_range[1], "the sparse points", scale[1]))
    if [truth.shape for truth in truths] == [depth.shape for depth in points]:
        warnings.append(ratio_warning(_flat(truths), _flat(points), "the ground truth", ratio_remedy(reader)))
    check.problems.extend(warning for warning in warnings if warning is not None)


def _flat(maps: Sequence[np.ndarray]) -> np.ndarray:
    """The pixels of all maps, concatenated."""
    return np.concatenate([depth.ravel() for depth in maps])


def _range(maps: Sequence[np.ndarray], depth_range: tuple[float, float]) -> str:
    near, far = depth_range
    values = _flat(maps)
    values = values[values > 0]
    if not values.size:
        return "no depth at all"
    least, median, most = np.percentile(values, (1, 50, 99))
    inside = np.mean((values >= near) & (values <= far))
    return (
        f"{least:.2f} to {most:.2f} m (1st to 99th percentile), {median:.2f} m in the median, {inside:.0%} within "
        f"{near:g} to {far:g} m"
    )


def _check_poses(reader: Reader, neighbours: Sequence[Triplet], check: SplitCheck) -> None:
    """Report the camera's motion between neighbouring frames."""
    poses = [(pose_of(reader, target), pose_of(reader, sources[0])) for target, sources in neighbours]
    motions = [motion(pose, other) for pose, other in poses if pose is not None and other is not None]
    if motions:
        distance, angle = np.median(motions, axis=0)
        check.facts.append(f"the camera moves {distance:.3f} m and {angle:.2f} degrees a frame (median)")
    elif neighbours:
        check.facts.append("no poses: train with pose=learned")
    else:
        check.facts.append("no neighbouring frames: poses cannot be checked")


def _pair(reader: Reader, triplet: Triplet) -> FramePair | None:
    """A frame and its neighbour; None without poses, ground truth or a neighbour, or if their sizes differ."""
    target, sources = triplet
    if not sources:
        return None
    depth, pose, source_pose = ground_truth_of(reader, target), pose_of(reader, target), pose_of(reader, sources[0])
    if depth is None or pose is None or source_pose is None:
        return None
    image, source = image_of(reader, target), image_of(reader, sources[0])
    if not image.shape[:2] == depth.shape == source.shape[:2]:
        return None
    cameras = intrinsics_of(reader, target), intrinsics_of(reader, sources[0])
    return FramePair(image, source, depth, *cameras, pose, source_pose)


def _check_warp(reader: Reader, neighbours: Sequence[Triplet], check: SplitCheck) -> None:
    """Compare the warp error of the true depth with the error without motion."""
    pairs = [pair for triplet in neighbours if (pair := _pair(reader, triplet)) is not None]
    if not pairs:
        return
    errors = warp_errors(pairs, getattr(reader, "scale", None))
    if not math.isfinite(errors.identity):
        check.facts.append("no ground truth at any pixel of neighbouring frames: poses cannot be checked")
        return
    check.warp = errors
    check.facts.append(
        f"warp error of the true depth: {errors.warped:.1f} of 255 to the neighbouring frame; with no motion "
        f"{errors.identity:.1f}"
    )
    if not errors.right:
        explanation = errors.explanation or "it is more than half of the error with no motion"
        check.problems.append(
            f"according to the warp error of the true depth, the poses, their unit or that of the depth are wrong: "
            f"{explanation}."
        )


def _preview(reader: Reader, triplet: Triplet) -> PreviewFrame:
    pair = _pair(reader, triplet)
    target = triplet.target
    return PreviewFrame(
        f"{target.sequence} {target.name}",
        image_of(reader, target),
        sparse_depth_of(reader, target),
        ground_truth_of(reader, target),
        None if pair is None else warp(pair, pair.pose, pair.source_pose),
    )
