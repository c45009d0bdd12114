"""Triplets of a split: each target with its source frames, chosen by parallax or at fixed offsets in time."""

import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import groupby

import numpy as np

from deux.contracts import FrameReference, Neighbourhood, Reader, Triplet
from deux.data.checked_frames import chosen_triplets_of, image_of, intrinsics_of, pose_of, sparse_depth_of, triplets_of
from deux.errors import DeuxError, counted
from deux.geometry.source_frames import SOURCES, SourceRule, SourceView, choose_sources
from deux.io.layout import SourceChoice
from deux.log_once import warn_once

PAPER_OFFSETS = (-1, -2)
"""t-1 and t-2, the default of `training.offsets`."""

_COMPARED_TRIPLETS = 16
"""Number of triplets whose cameras are compared."""

log = logging.getLogger(__name__)


def list_triplets(
    reader: Reader, split: str, choice: SourceChoice = "recent", offsets: tuple[int, ...] = PAPER_OFFSETS
) -> list[Triplet]:
    """List the targets of a split with their source frames, in the order of the split.

    With the choice "baseline", source frames are taken from the folder's list (`Reader.chosen_triplets`). If it has no
    such list, they are chosen by the poses and sparse points of the frames around each target
    (`deux.geometry.source_frames`), once in each process; sequences without poses use the offsets.

    Args:
        reader: the reader of the folder.
        split: "train", "validation" or "test".
        choice: how source frames are chosen.
        offsets: the recent source frames, as offsets from the target in frames; unused if the folder lists them.

    Raises:
        DeuxError: as `Reader.triplets`, or a pose or depth file that the choice needs is damaged.
    """
    if choice == "recent":
        return triplets_of(reader, split, offsets)
    listed = chosen_triplets_of(reader, split)
    if listed is not None:
        _warn_of_offsets(reader, offsets)
        return listed
    return list(_chosen(reader, split, offsets))


def count_without_sources(reader: Reader, split: str, choice: SourceChoice, offsets: tuple[int, ...]) -> int:
    """Count the targets of a split without source frames in `list_triplets`, without reading sparse points.

    Args:
        reader: the reader of the folder.
        split: see `list_triplets`.
        choice: see `list_triplets`.
        offsets: see `list_triplets`.
    """
    recent = triplets_of(reader, split, offsets)
    listed = chosen_triplets_of(reader, split) if choice == "baseline" else recent
    found = reader.neighbourhoods(split, SourceRule().reach) if listed is None else []
    if listed is not None or _none_to_choose(found, recent):
        return sum(not triplet.sources for triplet in (recent if listed is None else listed))
    given = {triplet.target for triplet in recent if triplet.sources}
    lacking = 0
    for _, group in groupby(found, key=lambda one: one.target.sequence):
        members = list(group)
        frames = dict.fromkeys(frame for target, around in members for frame in (target, *around.values()))
        posed = {frame for frame in frames if pose_of(reader, frame) is not None}
        if any(target in posed for target, _ in members):
            enough = {t for t, around in members if t in posed and len(posed & {*around.values()}) >= SOURCES}
        else:
            enough = given
        lacking += sum(target not in enough for target, _ in members)
    return lacking


def warn_of_cameras(reader: Reader, triplets: Sequence[Triplet]) -> None:
    """Warn if source frames have other intrinsics than their targets; for training with learned poses.

    Recorded poses account for the difference (`deux.geometry.poses.absorb_intrinsics`). A few triplets are compared,
    evenly spaced.

    Args:
        reader: the reader of the frames.
        triplets: the training triplets.
    """
    for target, sources in triplets[:: max(1, len(triplets) // _COMPARED_TRIPLETS)]:
        own = intrinsics_of(reader, target)
        for source in sources:
            if not np.allclose(intrinsics_of(reader, source), own, rtol=1e-3):
                warn_once(
                    log,
                    f"{reader.folder}: frame {source.name} of {source.sequence} has other intrinsics than "
                    f"{target.name}, whose source frame it is; with pose=learned photometric terms use the target's "
                    "for both, so record with a fixed focus and zoom",
                )
                return


def sources_by_parallax(
    reader: Reader, frames: Sequence[FrameReference]
) -> dict[FrameReference, tuple[FrameReference, ...]]:
    """Choose the source frames of each frame by parallax, among the frames around it in its sequence.

    Args:
        reader: the reader of the folder.
        frames: the frames of each sequence in the order of time.

    Returns:
        The source frames by frame; empty for a frame without a pose or with too few frames with poses around it.
    """
    found: dict[FrameReference, tuple[FrameReference, ...]] = {}
    reach = SourceRule().reach
    for _, group in groupby(frames, key=lambda frame: frame.sequence):
        members = list(group)
        around = [
            Neighbourhood(
                target,
                {
                    step: members[number + step]
                    for step in range(max(-reach, -number), min(reach, len(members) - 1 - number) + 1)
                    if step
                },
            )
            for number, target in enumerate(members)
        ]
        found |= dict(_choose(reader, around))
    return found


@lru_cache(maxsize=16)
def _chosen(reader: Reader, split: str, offsets: tuple[int, ...]) -> tuple[Triplet, ...]:
    triplets = triplets_of(reader, split, offsets)
    found = reader.neighbourhoods(split, SourceRule().reach)
    if all(len(one.frames) <= SOURCES for one in found) and _none_to_choose(found, triplets):
        return tuple(triplets)
    targets = counted(len(found), f"{split} frame")
    log.info("choosing source frames of %s of %s by their parallax", targets, reader.folder)
    chosen: list[Triplet] = []
    recent = {triplet.target: triplet for triplet in triplets}
    for sequence, group in groupby(found, key=lambda one: one.target.sequence):
        members = list(group)
        if any(pose_of(reader, one.target) is not None for one in members):
            _warn_of_offsets(reader, offsets)
            chosen += _choose(reader, members)
            continue
        log.info("%s has no poses of %s: its source frames are those at training.offsets", reader.folder, sequence)
        chosen += [recent[one.target] for one in members if one.target in recent]
    return tuple(chosen)


def _none_to_choose(found: Sequence[Neighbourhood], recent: Sequence[Triplet]) -> bool:
    """Whether there is no choice: no target has more candidates than it needs, and these are those at the offsets."""
    given = {triplet.target for triplet in recent if triplet.sources}
    return all(len(one.frames) <= SOURCES and (len(one.frames) < SOURCES or one.target in given) for one in found)


def _warn_of_offsets(reader: Reader, offsets: tuple[int, ...]) -> None:
    """Warn that offsets other than the default are not used."""
    if offsets != PAPER_OFFSETS:
        warn_once(
            log,
            f"training.offsets={list(offsets)} is not used: the source frames of {reader.folder} are chosen by their "
            "parallax; training.sources=recent takes those at the offsets.",
        )


def _choose(reader: Reader, members: list[Neighbourhood]) -> Iterator[Triplet]:
    """Choose the source frames of one sequence's targets."""
    frames = dict.fromkeys(frame for target, around in members for frame in (target, *around.values()))
    with ThreadPoolExecutor() as pool:  # decoding releases the GIL
        views = dict(zip(frames, pool.map(lambda frame: _view(reader, frame), frames), strict=True))
    for target, around in members:
        view = views[target]
        there = {step: other for step, frame in around.items() if (other := views[frame]) is not None}
        steps = choose_sources(view, there).steps if view is not None else ()
        yield Triplet(target, tuple(around[step] for step in steps))


def _view(reader: Reader, frame: FrameReference) -> SourceView | None:
    """The pose, camera and points of a frame, by which it is chosen; None if it has no pose."""
    pose = pose_of(reader, frame)
    if pose is None:
        return None
    try:
        sparse_depth = sparse_depth_of(reader, frame)
    except DeuxError:  # a frame of a video without depth; a target's damaged depth is reported when it is trained on
        sparse_depth = np.zeros(image_of(reader, frame).shape[:2], np.float32)
    return SourceView.of(pose, intrinsics_of(reader, frame), sparse_depth)
