"""Recorded frames that a task is given: how they are read, what of them counts, and whether they look right."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.configuration import run_folder, user_path
from deux.contracts import DepthModel, FrameReference, MissingSplit, Reader, Triplet
from deux.data.chosen_sources import list_triplets
from deux.data.depth_unit import points_scale, ratio_remedy, ratio_warning, unit_warning
from deux.data.even_choice import evenly_chosen
from deux.errors import DeuxError, counted, plural
from deux.io.calibration import camera_warning
from deux.io.file_digest import file_digest
from deux.io.layout import SourceChoice
from deux.task_sections import Sections
from deux.tasks.console import say

CHECKED = 8
"""Frames of a split, spread evenly over it, whose camera and unit of depth are looked at."""

log = logging.getLogger(__name__)


class Needs(NamedTuple):
    """What a task reads of frames besides image, sparse points and intrinsics.

    Args:
        sources: source frames; frames that have none are left out.
        poses: the frames' poses.
        ground_truth: the true depth.
    """

    sources: bool = False
    poses: bool = False
    ground_truth: bool = False


def read_given(sections: Sections, folder: str) -> Reader:
    """The reader of a folder of recorded frames, as the section `data` says it is read."""
    reader: Reader = sections.plugin("data").create(user_path(folder))
    return reader


def validation_of(
    reader: Reader, offsets: tuple[int, ...], needs: Needs, choice: SourceChoice = "recent"
) -> list[Reader]:
    """The reader itself if its folder has frames to validate on; none, and a line that says why, if it has not.

    Args:
        reader: of the recorded frames.
        offsets: the recent source frames, in frames from the target, where the folder does not list them.
        needs: what the training reads.
        choice: how source frames are chosen.

    Raises:
        DeuxError: a file is missing, damaged or of another kind.
    """
    try:
        found = _listed(reader, "validation", offsets, needs, choice)
    except MissingSplit as error:
        say(f"  no validation: {error}")
        return []
    if needs.sources and not any(triplet.sources for triplet in found):
        where = _where(offsets, choice)
        say(f"  no validation: none of the validation frames of {reader.folder} has source frames{where}")
        return []
    targets = [triplet.target for triplet in found]
    for sequence, target in {target.sequence: target for target in targets}.items():
        if reader.ground_truth(target) is None:
            say(f"  no validation: {reader.folder} has no ground truth of {sequence}")
            return []
    looked_at = evenly_chosen(targets, CHECKED)
    if not any((truth := reader.ground_truth(frame)) is not None and truth.any() for frame in looked_at):
        frames = counted(len(looked_at), "validation frame")
        say(f"  no validation: the ground truth of all {frames} of {reader.folder} that were read is 0, no value")
        return []
    return [reader]


def check_recorded(
    reader: Reader,
    split: str,
    offsets: tuple[int, ...],
    model: DepthModel,
    needs: Needs,
    choice: SourceChoice = "recent",
) -> None:
    """Say how many frames of a split are used, and look at some of them before any work is done.

    Warns of depth in a likely other unit and of intrinsics of images of another size.

    Args:
        reader: of the recorded frames.
        split: "train", "validation" or "test".
        offsets: the recent source frames, in frames from the target, where the folder does not list them.
        model: gives the depths that are plausible.
        needs: what the task reads.
        choice: how source frames are chosen.

    Raises:
        DeuxError: there are no frames, or no poses though they are needed, or training frames have no points, or a file
            is missing, damaged or of another kind.
    """
    found = _listed(reader, split, offsets, needs, choice)
    complete = [triplet for triplet in found if triplet.sources or not needs.sources]
    lacking = len(found) - len(complete)
    others = f"; {counted(lacking, 'other')} {plural('has', lacking)} no source frames{_where(offsets, choice)}"
    say(f"  {counted(len(complete), f'{split} frame')} of {reader.folder}{others if lacking else ''}")
    if not complete:
        return  # the data module says so in a sentence
    chosen = evenly_chosen([triplet.target for triplet in complete], CHECKED)
    if needs.poses:
        _check_poses(reader, chosen)
    if split == "train":
        _check_points(reader, chosen)
    _check_cameras_and_units(reader, chosen, model, needs.ground_truth)


def check_frames(reader: Reader, frames: Sequence[FrameReference], model: DepthModel) -> None:
    """Look at some of the frames: warn of depth in a likely other unit and of intrinsics of images of another size.

    Args:
        reader: of the recorded frames.
        frames: at least one.
        model: gives the depths that are plausible.

    Raises:
        DeuxError: a file is missing, damaged or of another kind.
    """
    _check_cameras_and_units(reader, evenly_chosen(frames, CHECKED), model, truth=True)


def given_files(reader: Reader, option: str, sections: Sections) -> dict[str, str]:
    """What identifies the files of recorded frames, for `deux.tasks.run_folder.open_run_folder`.

    An option holds a folder's path, and the frames in it, their cameras and poses may change while that stays the same.

    Args:
        reader: of the recorded frames.
        option: that names its folder.
        sections: say where outputs lie, which may be in that folder.

    Returns:
        A digest by the option's name.
    """
    values = [value for name, value in vars(reader).items() if not name.startswith("_")]
    paths = [user_path(value) for value in values if isinstance(value, Path)]
    return {option: file_digest(paths, [sections.outputs, run_folder()])}


def _listed(reader: Reader, split: str, offsets: tuple[int, ...], needs: Needs, choice: SourceChoice) -> list[Triplet]:
    found = list_triplets(reader, split, choice if needs.sources else "recent", offsets)
    if not found:
        raise MissingSplit(
            f"the {split} split of {reader.folder} has no frames, as {type(reader).__name__} reads it: name a folder "
            "that has some, or by the options under `data` which are the split's."
        )
    return found


def _where(offsets: tuple[int, ...], choice: SourceChoice) -> str:
    return f" at {list(offsets)}" if choice == "recent" else ""


def _check_cameras_and_units(reader: Reader, frames: Sequence[FrameReference], model: DepthModel, truth: bool) -> None:
    for frame in {frame.sequence: frame for frame in frames}.values():
        height, width = reader.sparse_depth(frame).shape
        camera = f"the camera matrix of {frame.sequence} in {reader.folder}"
        _warn(camera_warning(reader.intrinsics(frame), height, width, camera))
    _check_unit(reader, frames, truth, model.max_depth)


def _check_poses(reader: Reader, frames: Sequence[FrameReference]) -> None:
    for frame in frames:
        if reader.pose(frame) is None:
            raise DeuxError(
                f"pose=simulator needs the poses of the frames, and {reader.folder} has none of {frame.sequence}: use "
                "pose=learned, or frames with poses."
            )


def _check_points(reader: Reader, frames: Sequence[FrameReference]) -> None:
    if not any(reader.sparse_depth(frame).any() for frame in frames):
        raise DeuxError(
            f"none of the {counted(len(frames), 'frame')} of {reader.folder} that were read has a sparse point, and "
            "depth completion is trained on these: depth maps that are 0 everywhere hold no value."
        )


def _check_unit(reader: Reader, frames: Sequence[FrameReference], truth: bool, max_depth: float) -> None:
    """Warn of frames without points, and of points and ground truth that are likely to be in another unit."""
    points = [reader.sparse_depth(frame) for frame in frames]
    if empty := sum(not depth.any() for depth in points):
        read = counted(len(points), "frame")
        log.warning(f"{empty} of the {read} of {reader.folder} that were read {plural('has', empty)} no point.")
    if (scale := points_scale(reader)) is not None:
        flat = np.concatenate([depth.ravel() for depth in points])
        _warn(unit_warning(flat, scale[0], max_depth, f"the points of {reader.folder}", scale[1]))
    maps = [reader.ground_truth(frame) for frame in frames] if truth else []
    pairs = [
        (known.ravel(), depth.ravel())
        for known, depth in zip(maps, points, strict=False)
        if known is not None and known.shape == depth.shape
    ]
    if pairs:
        known, depth = (np.concatenate(values) for values in zip(*pairs, strict=True))
        _warn(ratio_warning(known, depth, f"the ground truth of {reader.folder}", ratio_remedy(reader)))


def _warn(sentence: str | None) -> None:
    if sentence is not None:
        log.warning(sentence)
