"""The reader of frames in no dataset layout: a folder of images or a video, sparse depth maps and a camera matrix."""

import logging
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, MissingSplit, Reader, Triplet
from deux.errors import DeuxError
from deux.io.camera_files import read_any_depth, read_any_image, read_any_intrinsics
from deux.io.frame_files import DEPTH_SUFFIXES, IMAGE_SUFFIXES, depthless_images, list_files, matching
from deux.io.images import DEPTH_SCALE
from deux.io.layout import frame_name
from deux.io.video_files import VIDEO_SUFFIXES, VideoReader

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LooseFrames(Reader):
    """Reads a folder of images or a video as one sequence without poses, with sparse depth in a separate folder.

    Depth maps are matched with images by name or number. Those of a video are matched in order if there are as many
    files as frames; otherwise the last number in the file's name, which must be unique, is the frame's index from 0.
    Frames without sparse depth are left out.

    Args:
        folder: the folder of images, or the video file.
        sparse: the folder of sparse depth maps: 16-bit PNG files, or .npy files in metres.
        camera: a file with the camera matrix of all images.
        scale: stored values per metre of the PNG files.
        truth: the folder of ground truth, in the same formats as `sparse`; None for none.
        truth_scale: stored values per metre of its PNG files; None for `scale`.

    Raises:
        DeuxError: a folder or file is missing, or no image has a sparse depth map.
    """

    folder: Path
    sparse: Path
    camera: Path
    scale: float = DEPTH_SCALE
    truth: Path | None = None
    truth_scale: float | None = None

    def __post_init__(self) -> None:
        for folder in (self.sparse, self.truth):
            if folder is not None and not folder.is_dir():
                raise DeuxError(f"{folder} is not a folder: give the folder with one depth map for each frame.")
        if not self._is_video and not self._images:
            raise DeuxError(f"{self.folder} contains no images: {', '.join(IMAGE_SUFFIXES)} files are expected.")
        if not self._points:
            what = "frames of the video" if self._is_video else "images"
            raise DeuxError(
                f"{self.sparse} has no sparse depth of the {what} {self.folder}: a .png or .npy file with the name or "
                "number of each is expected."
            )

    def frames(self) -> list[FrameReference]:
        """The images that have sparse depth."""
        return [FrameReference(self.folder.stem, name) for name in self._points]

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        """All frames are in the split "test", without source frames."""
        if split != "test":
            raise MissingSplit(f"{self.folder} has no {split} split: all its frames are in the test split.")
        return [Triplet(frame, ()) for frame in self.frames()]

    def image(self, frame: FrameReference) -> np.ndarray:
        """H x W x 3 uint8."""
        return self._video.read(int(frame.name)) if self._is_video else read_any_image(self._images[frame.name])

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """3 x 3 float64, the same for all frames."""
        return read_any_intrinsics(self.camera)

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres, 0 = none."""
        return read_any_depth(self._points[frame.name], self.scale)

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """H x W float32 metres, 0 = none; None for a frame without ground truth."""
        file = self._truths.get(frame.name)
        return None if file is None else read_any_depth(file, self.truth_scale or self.scale)

    @property
    def _is_video(self) -> bool:
        return self.folder.suffix.lower() in VIDEO_SUFFIXES

    @cached_property
    def _video(self) -> VideoReader:
        return VideoReader(self.folder)

    @cached_property
    def _images(self) -> dict[str, Path]:
        if not self.folder.is_dir():
            raise DeuxError(f"{self.folder} is neither a folder of images nor a video ({', '.join(VIDEO_SUFFIXES)}).")
        return list_files(self.folder, IMAGE_SUFFIXES)

    @cached_property
    def _points(self) -> dict[str, Path]:
        found = self._files(self.sparse)
        if found and not self._is_video and (lacking := len(self._images) - len(found)):
            log.warning(depthless_images(self.folder, lacking, len(self._images)))
        return found

    @cached_property
    def _truths(self) -> dict[str, Path]:
        return {} if self.truth is None else self._files(self.truth)

    def _files(self, folder: Path) -> dict[str, Path]:
        """The folder's depth maps by the names of their frames, in the order of time."""
        files = list_files(folder, DEPTH_SUFFIXES)
        if not self._is_video:
            return matching(self._images, files)
        if len(files) == len(self._video):
            return {frame_name(number): path for number, path in enumerate(files.values())}
        numbered = {_last_number(name): path for name, path in files.items()}
        if len(numbered) < len(files):  # the numbers are not unique
            return {}
        return matching(map(frame_name, range(len(self._video))), numbered)


def _last_number(name: str) -> str:
    """The last number in a file's name, formatted as a frame's name; the file's name if it has no number."""
    digits = "".join(character if character.isdecimal() else " " for character in name).split()
    return frame_name(int(digits[-1])) if digits else name
