"""Exports of predicted sequences: coloured videos, fused point clouds, and recordings for a viewer."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from itertools import groupby
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference, Reader
from deux.data.frame_stream import FrameStream, RecordedFrame
from deux.errors import DeuxError
from deux.figures.cloud_view import draw_cloud
from deux.figures.depth_video import draw_video_frame
from deux.figures.viewer_recording import PredictionRecording
from deux.geometry.point_cloud import PointCloud, VoxelFusion, unproject
from deux.io.cloud_files import write_cloud
from deux.io.images import write_image
from deux.io.progress import Progress
from deux.io.video_files import VideoWriter
from deux.tasks.agreement_filter import AgreementFilter
from deux.tasks.depth_completion import CompletedDepth
from deux.tasks.predict_settings import PredictSettings
from deux.tasks.prediction_folder import PredictionFolder

_STRIDE = 4
"""Stride of the rows and columns of confidence maps from which a sequence's quantile is computed."""

log = logging.getLogger(__name__)


def export_sequences(
    results: PredictionFolder,
    reader: Reader,
    frames: Sequence[FrameReference],
    settings: PredictSettings,
    progress: Progress,
) -> list[Path]:
    """Export predicted frames, sequence by sequence, from the depth files.

    Args:
        results: the predicted depth of all frames.
        reader: reader of the recorded frames.
        frames: the frames, in temporal order within each sequence.
        settings: the section `predict`.
        progress: called with the number of exported frames.

    Returns:
        The files.

    Raises:
        DeuxError: a file cannot be read or written, or no point passes the filters.
    """
    if not (settings.video or settings.cloud_formats or settings.viewer):
        return []
    maps = (results.read_confidence(frame)[::_STRIDE, ::_STRIDE] for frame in frames)
    least = least_confidence(maps, settings)
    written: list[Path] = []
    done = 0
    for sequence, group in groupby(frames, key=lambda frame: frame.sequence):
        names = list(group)
        export = SequenceExport(results.folder, sequence, settings, _depth_range(results, names), least)
        consistent = _consistency_filter(results, reader, names, settings)
        with export:
            for name, frame in FrameStream(reader, depths=settings.viewer is not None)(names):
                export.add(name.name, frame, results.read(name), consistent(name))
                done += 1
                progress("export", done, len(frames))
        written += export.written
    return written


class SequenceExport:
    """Context manager that collects the frames of one sequence and completes the exported files at its exit.

    Args:
        folder: the run folder; files are written to its subfolders `videos`, `clouds` and `recordings`, under the
            sequence's name, which may contain slashes.
        sequence: name of the sequence.
        settings: the section `predict`.
        depth_range: range of the colour scale, metres.
        least: minimal confidence of points.
    """

    def __init__(
        self,
        folder: Path,
        sequence: str,
        settings: PredictSettings,
        depth_range: tuple[float, float],
        least: float,
    ) -> None:
        self.written: list[Path] = []
        """The exported files; filled at the exit."""
        self._clouds = [folder / "clouds" / f"{sequence}.{suffix}" for suffix in settings.cloud_formats]
        self._fusion = VoxelFusion(settings.voxel)
        self._range, self._least = depth_range, least
        self._without_pose = 0
        self._up = np.zeros(3)
        self._number = 0
        self._stack = ExitStack()
        self._video = VideoWriter(folder / "videos" / f"{sequence}.mp4") if settings.video else None
        self._recording = (
            PredictionRecording(folder / "recordings" / f"{sequence}.rrd", sequence, depth_range)
            if settings.viewer
            else None
        )

    def __enter__(self) -> "SequenceExport":
        for part in (self._video, self._recording):
            if part is not None:
                self._stack.enter_context(part)
        return self

    def __exit__(self, kind: type[BaseException] | None, *details: object) -> None:
        self._stack.__exit__(kind, *details)  # type: ignore[arg-type]
        if kind is not None:
            return
        self.written += [part.path for part in (self._video, self._recording) if part and part.path.exists()]
        if self._clouds:
            self._write_clouds()

    def add(self, name: str, frame: RecordedFrame, completed: CompletedDepth, mask: np.ndarray | None = None) -> None:
        """Add the next frame, in temporal order.

        Args:
            name: name of the frame.
            frame: the recorded frame.
            completed: its predicted depth.
            mask: H x W bool, the pixels that may become points; None for all.
        """
        if self._video is not None:
            self._video.write(draw_video_frame(frame.image, completed.depth, self._range, completed.confidence))
        cloud = frame_cloud(frame, completed, self._least, mask)
        if frame.pose is None:
            self._without_pose += 1
        elif self._clouds:
            self._fusion.add(*cloud)
            self._up -= frame.pose[:3, 1]  # the camera's y axis points down
        if self._recording is not None:
            self._recording.add(self._number, name, frame, completed.depth, completed.confidence, cloud)
        self._number += 1

    def _write_clouds(self) -> None:
        if self._without_pose == self._number:  # only other sequences have poses
            log.warning(f"{self._clouds[0]} is not written, since none of its {self._number} frames has a pose.")
            return
        if self._without_pose:
            log.warning(
                f"{self._without_pose} of the {self._number} frames have no pose and are not in {self._clouds[0]}."
            )
        cloud = self._fusion.cloud()
        check_not_empty(cloud, self._clouds[0], "predict.agreement or predict.keep")
        for path in self._clouds:
            write_cloud(path, cloud)
        picture = self._clouds[0].with_suffix(".png")
        write_image(picture, draw_cloud(cloud, self._up))
        self.written += [*self._clouds, picture]


def frame_cloud(
    frame: RecordedFrame, completed: CompletedDepth, least: float = 0.0, mask: np.ndarray | None = None
) -> PointCloud:
    """The coloured points of a frame; in world coordinates if it has a pose, else in camera coordinates.

    Args:
        frame: the recorded frame.
        completed: its predicted depth.
        least: minimal confidence of points; above 0, pixels without confidence are left out.
        mask: H x W bool, the pixels that may become points; None for all.
    """
    valid = completed.depth > 0
    if mask is not None:
        valid &= mask
    if completed.confidence is not None:
        valid &= completed.confidence >= least
    points = unproject(completed.depth, frame.intrinsics, frame.pose)[valid]
    return PointCloud(points.astype(np.float32), frame.image[valid])


def check_not_empty(cloud: PointCloud, path: Path, options: str = "predict.keep") -> None:
    """Raise DeuxError if a point cloud is empty; `options` are those to raise for more points."""
    if len(cloud.points) == 0:
        raise DeuxError(f"{path} would have no point: raise {options}, or lower predict.least_confidence.")


def least_confidence(maps: Iterator[np.ndarray], settings: PredictSettings) -> float:
    """The minimal confidence of points: the larger of `predict.least_confidence` and the quantile of `predict.keep`.

    Args:
        maps: confidence maps of all frames, H x W, 0 = no value; read only if `predict.keep` is set.
        settings: the section `predict`.
    """
    least = settings.least_confidence or 0.0
    if settings.keep is not None:
        values = np.concatenate([np.empty(0, np.float32), *(values[values > 0] for values in maps)])
        quantile = float(np.quantile(values, 1.0 - settings.keep)) if values.size else 1.0
        least = max(least, quantile, float(np.finfo(np.float32).tiny))
    return least


def _consistency_filter(
    results: PredictionFolder, reader: Reader, frames: Sequence[FrameReference], settings: PredictSettings
) -> Callable[[FrameReference], np.ndarray | None]:
    """A function that returns a frame's mask of consistent pixels, H x W bool, or None for all pixels."""
    if settings.agreement is None or not (settings.cloud_formats or settings.viewer):
        return lambda frame: None
    return AgreementFilter(results, reader, frames, settings.agreement)


def _depth_range(results: PredictionFolder, frames: Sequence[FrameReference]) -> tuple[float, float]:
    """Colour range of a whole sequence in metres, robust against single frames; per-frame ranges would flicker."""
    nearest, _, farthest = zip(*(results.records[frame].depth for frame in frames), strict=True)
    return float(np.percentile(nearest, 10)), float(np.percentile(farthest, 90))
