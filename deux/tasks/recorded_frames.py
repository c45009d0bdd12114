"""Recorded frames as input of a task: creating the reader, checking the frames, hashing the files."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.configuration import run_folder, user_path
from deux.contracts import DepthModel, FrameReference, MissingSplit, Reader, Triplet
from deux.data.checked_frames import ground_truth_of, intrinsics_of, pose_of, sparse_depth_of
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
"""Number of frames of a split, spread evenly, whose camera and unit of depth are checked."""

log = logging.getLogger(__name__)


class Needs(NamedTuple):
    """What a task reads of frames besides image, sparse points and intrinsics.

    Args:
        sources: source frames; frames without any are left out.
        poses: poses.
        ground_truth: ground truth depth.
    """

    sources: bool = False
    poses: bool = False
    ground_truth: bool = False


def make_reader(sections: Sections, folder: str) -> Reader:
    """The reader of the section `data`, for a folder of recorded frames."""
    reader: Reader = sections.plugin("data").create(user_path(folder))
    return reader


def validation_readers(
    reader: Reader, offsets: tuple[int, ...], needs: Needs, choice: SourceChoice = "recent"
) -> list[Reader]:
    """The reader itself if it has validation frames with ground truth; else an empty list, and the reason is printed.

    Args:
        reader: reader of the recorded frames.
        offsets: offsets of the recent source frames from the target, if the folder does not list source frames.
        needs: what the training reads.
        choice: how source frames are chosen.

    Raises:
        DeuxError: a file is missing, damaged or of the wrong type.
    """
    if reason := _no_validation(reader, offsets, needs, choice):
        say(f"  no validation: {reason}")
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
    """Print how many frames of a split are used, and check some of them before any work is done.

    Logs a warning if depth seems to be in a wrong unit, or intrinsics seem to be of images of another size.

    Args:
        reader: reader of the recorded frames.
        split: "train", "validation" or "test".
        offsets: offsets of the recent source frames from the target, if the folder does not list source frames.
        model: its depth range is the plausible one.
        needs: what the task reads.
        choice: how source frames are chosen.

    Raises:
        DeuxError: there are no frames, poses are needed and missing, training frames have no sparse points, or a file
            is missing, damaged or of the wrong type.
    """
    triplets = _list_triplets(reader, split, offsets, needs, choice)
    usable = [triplet for triplet in triplets if triplet.sources or not needs.sources]
    lacking = len(triplets) - len(usable)
    others = f"; {counted(lacking, 'other')} {plural('has', lacking)} no source frames{_at(offsets, choice)}"
    say(f"  {counted(len(usable), f'{split} frame')} of {reader.folder}{others if lacking else ''}")
    if not usable:
        return  # the data module raises the error
    frames = evenly_chosen([triplet.target for triplet in usable], CHECKED)
    if needs.poses:
        _check_poses(reader, frames)
    if split == "train":
        _check_points(reader, frames)
    _check_cameras_and_units(reader, frames, model, needs.ground_truth)


def check_frames(reader: Reader, frames: Sequence[FrameReference], model: DepthModel) -> None:
    """Check some of the frames, like `check_recorded`.

    Args:
        reader: reader of the recorded frames.
        frames: the frames, at least one.
        model: its depth range is the plausible one.

    Raises:
        DeuxError: a file is missing, damaged or of the wrong type.
    """
    _check_cameras_and_units(reader, evenly_chosen(frames, CHECKED), model, truth=True)


def data_digest(reader: Reader, option: str, sections: Sections) -> dict[str, str]:
    """Digest of the files of recorded frames, for `deux.tasks.run_folder.open_run_folder`.

    The option contains only a folder's path, and the files in it may change while the path stays the same.

    Args:
        reader: reader of the recorded frames.
        option: the option that gives the folder.
        sections: configuration; its output folder, which may be in that folder, is excluded.

    Returns:
        The digest by option.
    """
    values = [value for name, value in vars(reader).items() if not name.startswith("_")]
    paths = [user_path(value) for value in values if isinstance(value, Path)]
    return {option: file_digest(paths, [sections.outputs, run_folder()])}


def _no_validation(reader: Reader, offsets: tuple[int, ...], needs: Needs, choice: SourceChoice) -> str | None:
    """Why a model cannot be validated on a reader's frames; None if it can."""
    try:
        triplets = _list_triplets(reader, "validation", offsets, needs, choice)
    except MissingSplit as error:
        return str(error)
    if needs.sources and not any(triplet.sources for triplet in triplets):
        return f"none of the validation frames of {reader.folder} has source frames{_at(offsets, choice)}"
    targets = [triplet.target for triplet in triplets]
    for sequence, target in {target.sequence: target for target in targets}.items():
        if ground_truth_of(reader, target) is None:
            return f"{reader.folder} has no ground truth of {sequence}"
    checked = evenly_chosen(targets, CHECKED)
    if not any((truth := ground_truth_of(reader, frame)) is not None and truth.any() for frame in checked):
        frames = counted(len(checked), "validation frame")
        return f"the ground truth of all {frames} of {reader.folder} that were read is 0, which means no value"
    return None


def _list_triplets(
    reader: Reader, split: str, offsets: tuple[int, ...], needs: Needs, choice: SourceChoice
) -> list[Triplet]:
    triplets = list_triplets(reader, split, choice if needs.sources else "recent", offsets)
    if not triplets:
        raise MissingSplit(
            f"the {split} split of {reader.folder} has no frames for the {type(reader).__name__}: give a folder with "
            "such frames, or set the options under `data` that assign frames to the split."
        )
    return triplets


def _at(offsets: tuple[int, ...], choice: SourceChoice) -> str:
    return f" at {list(offsets)}" if choice == "recent" else ""


def _check_cameras_and_units(reader: Reader, frames: Sequence[FrameReference], model: DepthModel, truth: bool) -> None:
    for frame in {frame.sequence: frame for frame in frames}.values():
        height, width = sparse_depth_of(reader, frame).shape
        camera = f"the camera matrix of {frame.sequence} in {reader.folder}"
        _warn(camera_warning(intrinsics_of(reader, frame), height, width, camera))
    _check_unit(reader, frames, truth, model.max_depth)


def _check_poses(reader: Reader, frames: Sequence[FrameReference]) -> None:
    for frame in frames:
        if pose_of(reader, frame) is None:
            raise DeuxError(
                f"pose=simulator needs the poses of the frames, and {reader.folder} has none for {frame.sequence}: use "
                "pose=learned, or frames with poses."
            )


def _check_points(reader: Reader, frames: Sequence[FrameReference]) -> None:
    if not any(sparse_depth_of(reader, frame).any() for frame in frames):
        raise DeuxError(
            f"none of the {counted(len(frames), 'frame')} of {reader.folder} that were read has a sparse point, which "
            "depth completion needs: give frames whose sparse depth is not 0 everywhere."
        )


def _check_unit(reader: Reader, frames: Sequence[FrameReference], truth: bool, max_depth: float) -> None:
    """Warn of frames without sparse points, and of points and ground truth that seem to be in a wrong unit."""
    sparse = [sparse_depth_of(reader, frame) for frame in frames]
    if empty := sum(not depth.any() for depth in sparse):
        read = counted(len(sparse), "frame")
        log.warning(f"{empty} of the {read} of {reader.folder} that were read {plural('has', empty)} no sparse point.")
    if (scale := points_scale(reader)) is not None:
        points = np.concatenate([depth.ravel() for depth in sparse])
        _warn(unit_warning(points, scale[0], max_depth, f"the points of {reader.folder}", scale[1]))
    dense = [ground_truth_of(reader, frame) for frame in frames] if truth else []
    pairs = [
        (target.ravel(), depth.ravel())
        for target, depth in zip(dense, sparse, strict=False)
        if target is not None and target.shape == depth.shape
    ]
    if pairs:
        target, depth = (np.concatenate(values) for values in zip(*pairs, strict=True))
        _warn(ratio_warning(target, depth, f"the ground truth of {reader.folder}", ratio_remedy(reader)))


def _warn(message: str | None) -> None:
    if message is not None:
        log.warning(message)
