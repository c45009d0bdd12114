"""The reader `data=rgbd_folder`: custom RGB-D video as folders of images and depth maps."""

import logging
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from deux.collection.sparse import SparseSettings
from deux.contracts import FrameReference, MissingSplit
from deux.errors import DeuxError, check_range
from deux.geometry.poses import motion
from deux.io.camera_files import read_any_image, read_any_intrinsics
from deux.io.frame_files import DEPTH_SUFFIXES, IMAGE_SUFFIXES, depthless_images, list_files, matching
from deux.io.layout import natural_order
from deux_plugins.readers.parts.frame_blocks import Division
from deux_plugins.readers.parts.recorded_video import (
    Clip,
    FrameFiles,
    Frames,
    RecordedVideo,
    check_video_options,
    report_skipped,
)
from deux_plugins.readers.parts.trajectory_files import TRAJECTORY_FILES, read_trajectory

IMAGE_FOLDERS = ("images", "image", "rgb", "color", "colour")
DEPTH_FOLDERS = ("depth", "depths", "ground_truth")
SPARSE_FOLDERS = ("sparse", "sparse_depth")
INTRINSICS_FILES = ("K.txt", "intrinsics.txt", "camera_matrix.txt", "K.npy", "intrinsics.npy")
INTRINSICS_FOLDERS = ("intrinsics", "K")

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RgbdFolder(RecordedVideo):
    """Reads one video, or a folder with a subfolder for each of several.

        <video>/
            images/ (or image, rgb, color)   <frame>.png or .jpg
            depth/                           <frame>.png, 16 bits, or .npy of metres; registered to the images
            sparse/ (or sparse_depth)        optional, as depth/; without it points are sampled from depth/
            K.txt (or intrinsics.txt)        3 x 3, in pixels of the images; a folder intrinsics/ has one for each frame
            poses.txt                        optional; see `read_trajectory` for the formats

    Depth maps, poses and camera matrices of single frames are matched with images by name or number. Frames are ordered
    by the numbers in their names. A frame without depth is not a target. If a video has poses, frames without a pose
    are not used for training, but they are evaluated. K.txt may also be in the parent folder, for all videos.

    Args:
        folder: the video, or the folder of videos.
        images: name of the folders of images, if it is none of those above.
        depth: name of the folders of depth maps, likewise.
        sparse: name of the folders of sparse points, likewise.
        poses: name of the file or folder of poses, likewise.
        world_to_camera: whether the pose files contain world-to-camera matrices.
        fx: focal length along the rows, pixels; with fy, cx and cy it replaces K.txt.
        fy: focal length along the columns, pixels.
        cx: column of the principal point, pixels, 0 at the centre of the first pixel.
        cy: row of the principal point, likewise.
        scale: stored depth values per metre in PNG files: 1000 for millimetres.
        sparse_scale: stored depth values per metre of the files in sparse/; None for `scale`.
        gap: distance of source frames in frames, multiplied by the offsets.
        min_distance: training frames are dropped as static if the camera has moved less than this, in metres, and
            turned less than `min_angle` since the last frame that was not dropped.
        min_angle: see `min_distance`; degrees.
        min_difference: without poses, training frames are dropped as static if their mean absolute difference from the
            last frame that was not dropped is less, in grey levels of 255; above 0 all images are read at the start.
        density: number of sparse points as a fraction of the pixels, if they are sampled.
        split_by: "frames" divides each video into training, validation and test frames, in this order; "videos" assigns
            whole videos, of which the last by name are for test.
        validation: fraction of the frames or videos in the validation split.
        test: fraction in the test split.
        margin: number of frames between two splits of a video that are targets of neither.

    Raises:
        DeuxError: no video is found, a video has no depth or intrinsics, or an option is out of range.
    """

    folder: Path
    images: str | None = None
    depth: str | None = None
    sparse: str | None = None
    poses: str | None = None
    world_to_camera: bool = False
    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None
    scale: float = 1000.0
    sparse_scale: float | None = None
    gap: int = 1
    min_distance: float = 0.01
    min_angle: float = 1.0
    min_difference: float = 0.0
    density: float = SparseSettings.density
    split_by: Literal["frames", "videos"] = "frames"
    validation: float = 0.1
    test: float = 0.2
    margin: int = 5

    def __post_init__(self) -> None:
        check_video_options(self.gap, self.scale, self.density)
        if self.sparse_scale is not None:
            check_range("data.sparse_scale", self.sparse_scale, 0, ends=False)
        for name in ("min_distance", "min_angle", "min_difference", "margin"):
            check_range(f"data.{name}", getattr(self, name), 0)
        for name in ("validation", "test"):
            check_range(f"data.{name}", getattr(self, name), 0, 1)
        check_range("data.validation + data.test", self.validation + self.test, 0, 1)
        given = [name for name in ("fx", "fy", "cx", "cy") if getattr(self, name) is not None]
        if given and len(given) < 4:
            raise DeuxError(
                f"data.{given[0]} is set: all of data.fx, data.fy, data.cx and data.cy are needed together."
            )
        if not self._videos:
            raise DeuxError(
                f"{self.folder} has no RGB-D video: a folder {' or '.join(self._image_folders)} of .png or .jpg files "
                "is expected in it or in its subfolders; set data.images if it has another name."
            )

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """3 x 3 float64: from the options, the file of the frame, the video or the parent folder."""
        if self.fx is not None:
            return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]], dtype=np.float64)
        video = self._videos[frame.sequence]
        own = self._cameras[frame.sequence].get(frame.name)
        shared = [folder / name for folder in (video, self.folder) for name in INTRINSICS_FILES]
        for path in ([] if own is None else [own]) + shared:
            if path.is_file():
                return read_any_intrinsics(path)
        folders = [folder for name in INTRINSICS_FOLDERS if (folder := video / name).is_dir()]
        if folders:
            raise DeuxError(
                f"Frame {frame.name} of {frame.sequence} in {self.folder} has no intrinsics: {folders[0]} contains no "
                ".txt or .npy file with its name, nor files with the numbers of all frames, and there is no K.txt."
            )
        raise DeuxError(
            f"{video} has no intrinsics: K.txt with nine numbers in it, or data.fx, data.fy, data.cx and data.cy are "
            "expected, in pixels."
        )

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        """4 x 4 float64, camera-to-world; None for a frame without a pose."""
        pose = self._poses[frame.sequence].get(frame.name)
        return None if pose is None else pose.copy()

    def _find(self) -> Frames:
        found: Frames = {}
        any_points = False
        for sequence, video in self._videos.items():
            images = self._images_of(video)
            depths = matching(images, _files_in(video, _choice(self.depth, DEPTH_FOLDERS), DEPTH_SUFFIXES))
            points = matching(images, _files_in(video, _choice(self.sparse, SPARSE_FOLDERS), DEPTH_SUFFIXES))
            any_points = any_points or bool(points)
            if not depths and not points:
                raise DeuxError(
                    f"{video} has no depth maps with the names or numbers of its images: a folder "
                    f"{' or '.join(_choice(self.depth, DEPTH_FOLDERS))} of .png or .npy files is expected; set "
                    "data.depth if it has another name."
                )
            found[sequence] = {}
            for name, image in images.items():
                # If a video has sparse points, frames without them are not filled in by sampling.
                truth = depths.get(name) if name in points or not points else None
                found[sequence][name] = FrameFiles(image, points.get(name), truth, self.scale, self.sparse_scale)
        if self.sparse_scale is not None and not any_points:
            raise DeuxError(
                f"data.sparse_scale={self.sparse_scale:g} is for sparse points, but {self.folder} has no folder "
                f"{' or '.join(_choice(self.sparse, SPARSE_FOLDERS))}: set data.scale for its depth maps."
            )
        depthless = [not files.has_depth for frames in found.values() for files in frames.values()]
        if any(depthless):
            log.warning(depthless_images(self.folder, sum(depthless), len(depthless)))
        return found

    def _images_of(self, video: Path) -> dict[str, Path]:
        """The images of a video by the frames' names."""
        images = _files_in(video, self._image_folders, IMAGE_SUFFIXES)
        if not images:
            folder = _subfolder(video, self._image_folders)
            raise DeuxError(f"{folder} contains no images: {', '.join(IMAGE_SUFFIXES)} files are expected.")
        return images

    def _clips(self, split: str) -> list[Clip]:
        clips = []
        skipped: Counter[str] = Counter()
        for sequence, (before, block) in self._blocks(split).items():
            files, posed = self._frames[sequence], self._posed(sequence)
            if split == "train":
                skipped["without pose"] += sum(name not in posed for name in block)
                frames = self._moving(sequence, [name for name in block if name in posed])
                skipped["static"] += sum(name in posed for name in block) - len(frames)
                targets = [name for name in frames if files[name].has_depth]
                skipped["without depth"] += len(frames) - len(targets)
                if self.split_by == "frames":
                    skipped["between splits"] += self._division.between(len(self._frames[sequence]))
            else:
                frames = [name for name in (*before, *block) if name in posed]
                targets = [name for name in block if files[name].has_depth]
                skipped["without depth"] += len(block) - len(targets)
            clips.append(Clip(sequence, targets, frames, self.gap))
        report_skipped(f"{self.folder}, {split}", sum(len(clip.targets) for clip in clips), skipped)
        if skipped["static"] and not any(clip.frames for clip in clips):
            raise MissingSplit(f"{self.folder} has no {split} frames: {self._still}")
        if split == "train" and any(clip.targets for clip in clips) and self.split_by == "frames":
            lengths = {video: len(self._frames[video]) for video in self._videos}
            if (warning := self._division.untrained(lengths, self.folder)) is not None:
                log.warning(warning)
        return clips

    def _expected(self, split: str) -> str:
        if split != "train" and getattr(self, split) == 0:
            return f"set data.{split}=0.1 to hold out a tenth of the {self.split_by}."
        return (
            f"data.validation={self.validation}, data.test={self.test}, data.margin={self.margin} and "
            f"data.gap={self.gap} leave none."
        )

    def _blocks(self, split: str) -> dict[str, tuple[list[str], list[str]]]:
        """For each video, the frames of the margin before the split, and the frames of the split."""
        if self.split_by == "videos":
            chosen = Division(self.validation, self.test, count=math.ceil).blocks(len(self._videos))[split]
            return {video: ([], list(self._frames[video])) for video in list(self._videos)[chosen]}
        found = {}
        for video in self._videos:
            names = list(self._frames[video])
            block = self._division.blocks(len(names))[split]
            free = 0 if split == "train" else self.margin
            found[video] = names[max(0, block.start - free) : block.start], names[block]
        return found

    @property
    def _division(self) -> Division:
        return Division(self.validation, self.test, self.margin)

    def _posed(self, sequence: str) -> Collection[str]:
        """The frames with a pose; all frames if the video has no poses."""
        return self._poses[sequence] or self._frames[sequence]

    def _moving(self, sequence: str, names: Sequence[str]) -> list[str]:
        """Drop static frames, in which the camera has not moved since the last kept frame; [] if it never moves."""
        poses = self._poses[sequence]
        if not poses and self.min_difference == 0:
            return list(names)
        kept: list[str] = []
        last: np.ndarray | None = None
        for name in names:
            now = poses[name] if poses else _grey(self._frames[sequence][name].image)
            if last is None or (self._apart(last, now) if poses else self._differ(last, now)):
                kept.append(name)
                last = now
        return [] if len(kept) == 1 < len(names) else kept

    @property
    def _still(self) -> str:
        """The reason why all frames are static, for the end of a sentence."""
        if any(self._poses.values()):
            near = f"within data.min_distance={self.min_distance:g} m and data.min_angle={self.min_angle:g} degrees of"
        else:
            near = f"with fewer than data.min_difference={self.min_difference:g} grey levels of difference from"
        return f"the camera does not move, all frames are {near} the first, but depth can only be learned from motion."

    def _apart(self, first: np.ndarray, second: np.ndarray) -> bool:
        distance, angle = motion(first, second)
        return distance >= self.min_distance or angle >= self.min_angle

    def _differ(self, first: np.ndarray, second: np.ndarray) -> bool:
        return first.shape != second.shape or float(np.abs(first - second).mean()) >= self.min_difference

    @cached_property
    def _cameras(self) -> dict[str, dict[str, Path]]:
        """The files of single frames' camera matrices in each video, by the frames' names."""
        found: dict[str, dict[str, Path]] = {}
        for sequence, video in self._videos.items():
            frames, found[sequence] = self._frames[sequence], {}
            for folder in reversed(INTRINSICS_FOLDERS):
                files = {**list_files(video / folder, (".npy",)), **list_files(video / folder, (".txt",))}
                matched = matching(frames, files)
                # Match by number only if all frames have a file: cam0 and cam1 are not the first two frames.
                named = matched if len(matched) == len(frames) else {n: files[n] for n in frames if n in files}
                found[sequence] |= named
        return found

    @cached_property
    def _poses(self) -> dict[str, dict[str, np.ndarray]]:
        """The camera-to-world matrices of each video, by the frames' names; empty for a video without poses."""
        found = {}
        for sequence, video in self._videos.items():
            path = next(
                (video / name for name in _choice(self.poses, TRAJECTORY_FILES) if (video / name).exists()), None
            )
            if path is None and self.poses is not None:
                raise DeuxError(f"data.poses is {self.poses}, but {video} has no such file or folder.")
            frames = list(self._frames[sequence])
            known = {} if path is None else read_trajectory(path, frames, self.world_to_camera)
            if path is not None and not known:
                raise DeuxError(
                    f"{path} has no pose of any image: the names or time stamps of the images must be in it."
                )
            found[sequence] = known
        return found

    @cached_property
    def _videos(self) -> dict[str, Path]:
        """The folder of each video, by its name, in natural order of the names."""
        if _subfolder(self.folder, self._image_folders) is not None:
            return {self.folder.resolve().name: self.folder}
        there = {
            path.name: path for path in self.folder.glob("*/") if _subfolder(path, self._image_folders) is not None
        }
        return {name: there[name] for name in sorted(there, key=natural_order)}

    @property
    def _image_folders(self) -> tuple[str, ...]:
        return _choice(self.images, IMAGE_FOLDERS)


def _choice(chosen: str | None, common: tuple[str, ...]) -> tuple[str, ...]:
    """The user's choice of a name, or the common names."""
    return common if chosen is None else (chosen,)


def _subfolder(video: Path, names: Sequence[str]) -> Path | None:
    """The first existing folder with one of these names."""
    return next((video / name for name in names if (video / name).is_dir()), None)


def _files_in(video: Path, names: Sequence[str], suffixes: tuple[str, ...]) -> dict[str, Path]:
    """The files in the first existing folder with one of these names; {} if there is none."""
    folder = _subfolder(video, names)
    return {} if folder is None else list_files(folder, suffixes)


def _grey(path: Path) -> np.ndarray:
    """Read an image as grey levels, H x W float32 from 0 to 255."""
    return cv2.cvtColor(read_any_image(path), cv2.COLOR_RGB2GRAY).astype(np.float32)
