"""The reader `data=nyu_v2`: NYU Depth V2 (Silberman et al., ECCV 2012), indoor images and video of a Kinect."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from deux.collection.sparse import SparseSettings
from deux.contracts import FrameReference
from deux.errors import DeuxError, check_range, image_size
from deux.io.calibration import read_intrinsics
from deux.io.frame_files import (
    DEPTH_SUFFIXES,
    IMAGE_SUFFIXES,
    list_files,
    matching,
)
from deux.io.layout import natural_order
from deux_plugins.readers.parts.labelled_images import LABELLED, LabelledImages
from deux_plugins.readers.parts.recorded_video import (
    Clip,
    FrameFiles,
    Frames,
    RecordedVideo,
    check_video_options,
    held_out,
    report_skipped,
)

KINECT = np.array(
    [[518.85790117450188, 0.0, 325.58244941119034], [0.0, 519.46961112127485, 253.73616633400465], [0.0, 0.0, 1.0]]
)
"""The colour camera's matrix from the dataset's toolbox, for images of 640 x 480 pixels."""

KINECT_SIZE = (480, 640)


@dataclass(frozen=True)
class _Layout:
    """A folder layout of the frames.

    Args:
        images: glob pattern of the folders of images.
        depth: (old, new), the replacement in the path of an image folder that gives the folder of its depth maps.
        image_names: glob pattern of the images.
        depth_names: glob pattern of the depth maps.
        scale: stored depth values per metre.
        gap: default of `NyuV2.gap`.
        single: the split of single frames; None for video.
    """

    images: str
    depth: tuple[str, str] = ("", "")
    image_names: str = "*"
    depth_names: str = "*"
    scale: float = 1000.0
    gap: int = 10
    single: Literal["train", "test"] | None = None


def _pairs(images: str, single: Literal["train", "test"] | None = None) -> _Layout:
    """The layout with images and depth maps in the same folder."""
    return _Layout(images, image_names="rgb_*", depth_names="sync_depth_*", gap=1, single=single)


_LAYOUTS = (
    *(_Layout(f"{base}*/rgb", ("/rgb", "/depth")) for base in ("", "sync/", "raw_data/")),
    *(_pairs(f"{base}*") for base in ("", "sync/", "raw_data/")),
    _Layout("training/images/raw_data/*", ("training/images", "training/depths"), scale=256.0),
    _pairs("train/*", single="train"),
    _pairs("test/*", single="test"),
    _Layout("testing/images", ("testing/images", "testing/depths"), scale=256.0, single="test"),
)


@dataclass(frozen=True)
class NyuV2(RecordedVideo):
    """Reads the labelled images, the synchronised video, or both from one folder.

    Video for training, where each <scene> is a sequence:

        [sync/|raw_data/]<scene>/rgb_<n>.jpg and sync_depth_<n>.png, millimetres
        [sync/|raw_data/]<scene>/{rgb,depth}/<n>.png (or .jpg), millimetres
        training/{images,depths}/raw_data/<scene>/<time stamp>.png, metres x 256, as in the KBNet family

    Single frames for evaluation. Without video, supervised models are trained on those of the training split:

        nyu_depth_v2_labeled.mat and splits.mat (795 training and 654 test images; needs pip install "deux[nyu]")
        {train,test}/<scene>/rgb_<n>.jpg and sync_depth_<n>.png, millimetres
        testing/{images,depths}/*.png, metres x 256

    Video of scenes in the test split is excluded from training and validation.

    The depth is used as ground truth, and sparse points are sampled from it at the image's corners. A file K.txt in the
    folder of the images, in its parent or in the dataset's folder replaces the Kinect's camera matrix; it is required
    for images of another size than 640 x 480. The published raw recordings (r-*.ppm, d-*.pgm) must be synchronised
    first, with the dataset's toolbox.

    Args:
        folder: the dataset's folder.
        gap: distance of source frames in frames, multiplied by the offsets; by default 10, as published, and 1 if
            images are named rgb_<n>, because extracted datasets of this form contain about every tenth frame.
        validation: number of training scenes, the last by name, that are held out for validation.
        density: number of sparse points as a fraction of the pixels.
        scale: stored depth values per metre; by default as above.

    Raises:
        DeuxError: the folder has none of these layouts, or an option is out of range.
    """

    folder: Path
    gap: int | None = None
    validation: int = 3
    density: float = SparseSettings.density
    scale: float | None = None

    def __post_init__(self) -> None:
        check_video_options(self.gap, self.scale, self.density)
        check_range("data.validation", self.validation, 0)
        if self._labelled is not None or next(self._image_folders(), None) is not None:
            return
        if any(self.folder.glob("*/[rd]-*.p[pg]m")) or any(self.folder.glob("*/*/[rd]-*.p[pg]m")):
            raise DeuxError(
                f"{self.folder} has the raw recordings, in which images and depth maps are not synchronised: "
                "synchronise them first with the dataset's toolbox (get_synched_frames, project_depth_map)."
            )
        raise DeuxError(
            f"{self.folder} has no layout of NYU Depth V2: {LABELLED}, <scene>/rgb_<n>.jpg with sync_depth_<n>.png, "
            "<scene>/rgb with <scene>/depth, or training/images/raw_data/<scene> is expected."
        )

    def image(self, frame: FrameReference) -> np.ndarray:
        """H x W x 3 uint8."""
        if self._labelled is not None and self._labelled.path == self._files(frame).image:
            return self._labelled.image(int(frame.name))
        return super().image(frame)

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        """H x W float32 metres, 0 = none."""
        if self._labelled is not None and self._labelled.path == self._files(frame).image:
            return self._labelled.depth(int(frame.name))
        return super().ground_truth(frame)

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        """The nearest K.txt, or else the Kinect's matrix; 3 x 3 float64."""
        image = self._files(frame).image
        for folder in (image.parent, image.parent.parent, self.folder):
            if (folder / "K.txt").exists():
                return read_intrinsics(folder / "K.txt")
        size = self.image(frame).shape[:2]
        if size != KINECT_SIZE:
            raise DeuxError(
                f"{image} has {image_size(size)} pixels, but the Kinect's matrix is for 640 x 480: write the matrix of "
                f"these images to {self.folder / 'K.txt'}."
            )
        return KINECT.copy()

    def _find(self) -> Frames:
        found: Frames = {}
        total = usable = 0
        for sequence, (layout, folder) in self._sequences.items():
            images = list_files(folder, IMAGE_SUFFIXES, layout.image_names)
            depths = list_files(_depth_folder(self.folder, folder, layout), DEPTH_SUFFIXES, layout.depth_names)
            truths = matching(images, depths)
            scale = layout.scale if self.scale is None else self.scale
            found[sequence] = {name: FrameFiles(image, None, truths.get(name), scale) for name, image in images.items()}
            total, usable = total + len(images), usable + len(truths)
        if total:
            report_skipped(self.folder, usable, {"without depth": total - usable})
        if self._labelled is not None:
            path = self._labelled.path
            for number, scene in enumerate(self._labelled.scenes, start=1):
                found.setdefault(f"labelled_{scene}", {})[f"{number:04d}"] = FrameFiles(path, None, path)
        return found

    def _clips(self, split: str) -> list[Clip]:
        if split == "test":
            return self._single_frames("test")
        clips = self._training_video or self._single_frames("train")
        scenes = sorted({clip.sequence for clip in clips}, key=natural_order)
        training, validation = held_out(scenes, self.validation, "scenes", self.folder) if scenes else ([], [])
        chosen = set(training if split == "train" else validation)
        return [clip for clip in clips if clip.sequence in chosen]

    @cached_property
    def _training_video(self) -> list[Clip]:
        """The video without that of scenes in the test split."""
        clips = self._video()
        tested = {_place(clip.sequence.partition("_")[2]) for clip in self._single_frames("test")} if clips else set()
        untested = [clip for clip in clips if _place(clip.sequence) not in tested]
        if len(untested) < len(clips):
            frames, usable = (sum(len(clip.targets) for clip in some) for some in (clips, untested))
            report_skipped(f"{self.folder}, video", usable, {"of scenes in the test split": frames - usable})
        return untested

    def _video(self) -> list[Clip]:
        clips = []
        for sequence, (layout, _) in self._sequences.items():
            frames = self._frames[sequence]
            if layout.single is None:
                gap = layout.gap if self.gap is None else self.gap
                clips.append(Clip(sequence, [n for n, files in frames.items() if files.has_depth], list(frames), gap))
        return clips

    def _single_frames(self, split: Literal["train", "test"]) -> list[Clip]:
        clips = []
        for sequence, (layout, _) in self._sequences.items():
            if layout.single == split:
                clips.append(Clip(sequence, [n for n, files in self._frames[sequence].items() if files.has_depth]))
        if self._labelled is not None:
            chosen = {f"{number:04d}" for number in self._labelled.split(split)}
            for sequence in sorted({f"labelled_{scene}" for scene in self._labelled.scenes}):
                if names := [name for name in self._frames[sequence] if name in chosen]:
                    clips.append(Clip(sequence, names))
        return clips

    def _expected(self, split: str) -> str:
        if split == "test":
            return f"{LABELLED} with splits.mat, test/<scene>/rgb_<n>.jpg or testing/images is expected."
        if split == "validation":
            return "set data.validation=3 to hold out three training scenes."
        return f"videos must be longer than data.gap={self.gap} requires, with a depth map for the name of each frame."

    @cached_property
    def _labelled(self) -> LabelledImages | None:
        path = self.folder / LABELLED
        return LabelledImages(path) if path.exists() else None

    @cached_property
    def _sequences(self) -> dict[str, tuple[_Layout, Path]]:
        """The layout of each sequence, and its folder of images; if two have the same name, the first is used."""
        found: dict[str, tuple[_Layout, Path]] = {}
        for sequence, layout, folder in self._image_folders():
            found.setdefault(sequence, (layout, folder))
        return found

    def _image_folders(self) -> Iterator[tuple[str, _Layout, Path]]:
        """The sequences on disk: name, layout and folder of images."""
        for layout in _LAYOUTS:
            for folder in sorted(self.folder.glob(layout.images)):
                if any(path.suffix.lower() in IMAGE_SUFFIXES for path in folder.glob(layout.image_names)):
                    scene = folder.parent.name if folder.name in ("rgb", "images") else folder.name
                    yield scene if layout.single is None else f"{layout.single}_{scene}", layout, folder


def _place(scene: str) -> str:
    """A scene's name without the letter of the recording: living_room_0086a and 0086b show the same room."""
    return re.sub(r"(?<=\d)[a-z]$", "", scene)


def _depth_folder(root: Path, images: Path, layout: _Layout) -> Path:
    """The folder of the depth maps for a folder of images."""
    old, new = layout.depth
    if not old:
        return images
    before, _, after = images.relative_to(root).as_posix().rpartition(old)
    return root / f"{before}{new}{after}"
