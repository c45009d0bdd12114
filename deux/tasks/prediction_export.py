"""What is made of many frames' depth files: coloured videos, fused point clouds, recordings for a viewer."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
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

_SAMPLED = 4
"""Every so many-th row and column of the confidence maps tells the quantile of a sequence."""

log = logging.getLogger(__name__)


def export_sequences(
    results: PredictionFolder,
    reader: Reader,
    frames: Sequence[FrameReference],
    settings: PredictSettings,
    progress: Progress,
) -> list[Path]:
    """Make what `settings` asks for of frames that are all done, sequence by sequence, from the files.

    Args:
        results: where the frames' depth lies.
        reader: of the recorded frames.
        frames: in the order of time within each sequence.
        settings: of the task.
        progress: told the number of frames.

    Returns:
        The files.

    Raises:
        DeuxError: a file cannot be read or written, or nothing passes the filter.
    """
    if not (settings.video or settings.cloud_formats or settings.viewer):
        return []
    least = _least_confidence(results, frames, settings)
    written: list[Path] = []
    done = 0
    for sequence, group in groupby(frames, key=lambda frame: frame.sequence):
        names = list(group)
        export = SequenceExport(results.folder, sequence, settings, _depth_range(results, names), least)
        confirmed = _confirmed(results, reader, names, settings)
        with export:
            for name, frame in FrameStream(reader, depths=settings.viewer is not None)(names):
                export.add(name.name, frame, results.read(name), confirmed(name))
                done += 1
                progress("export", done, len(frames))
        written += export.written
    return written


class SequenceExport:
    """Gathers the frames of one sequence in order of time, and writes the files when it is left. A context manager.

    Args:
        folder: the run's; files go to `videos/`, `clouds/` and `recordings/` in it, under the
            sequence's name, which may be a path.
        sequence: its name.
        settings: which files.
        depth_range: metres at the ends of the colours.
        least: confidence that points need.
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
        """The files, once it has been left."""
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

    def add(
        self, name: str, frame: RecordedFrame, completed: CompletedDepth, confirmed: np.ndarray | None = None
    ) -> None:
        """The next frame, with what was predicted of it.

        Args:
            name: of the frame.
            frame: as recorded.
            completed: its depth.
            confirmed: H x W bool, the pixels that may become points; None for all.
        """
        if self._video is not None:
            self._video.write(draw_video_frame(frame.image, completed.depth, self._range, completed.confidence))
        cloud = frame_cloud(frame, completed, self._least, confirmed)
        if frame.pose is None:
            self._without_pose += 1
        elif self._clouds:
            self._fusion.add(*cloud)
            self._up -= frame.pose[:3, 1]  # cameras are held upright on the whole; their y points down
        if self._recording is not None:
            self._recording.add(self._number, name, frame, completed.depth, completed.confidence, cloud)
        self._number += 1

    def _write_clouds(self) -> None:
        if self._without_pose == self._number:  # other sequences have poses, or no cloud could have been asked for
            log.warning(f"{self._clouds[0]} is not written, as none of its {self._number} frames has a pose.")
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
    frame: RecordedFrame, completed: CompletedDepth, least: float = 0.0, confirmed: np.ndarray | None = None
) -> PointCloud:
    """The coloured points of a frame whose confidence is at least `least`, in the world if it has a pose.

    Args:
        frame: as recorded.
        completed: its depth.
        least: confidence that a point needs; above 0 it leaves out the pixels that have none.
        confirmed: H x W bool, the pixels that may become points; None for all.
    """
    kept = completed.depth > 0
    if confirmed is not None:
        kept &= confirmed
    if completed.confidence is not None:
        kept &= completed.confidence >= least
    points = unproject(completed.depth, frame.intrinsics, frame.pose)[kept]
    return PointCloud(points.astype(np.float32), frame.image[kept])


def check_not_empty(cloud: PointCloud, path: Path, limits: str = "predict.keep") -> None:
    """Raise DeuxError if a cloud that is to be written has no point; `limits` are the options that let more pass."""
    if len(cloud.points) == 0:
        raise DeuxError(f"{path} would hold no point: raise {limits}, or lower predict.least_confidence.")


def least_confidence(maps: Iterator[np.ndarray], settings: PredictSettings) -> float:
    """The confidence that a point needs by `predict.least_confidence` and by the quantile of `predict.keep`.

    Args:
        maps: H x W confidences of all frames, 0 = none; read only if `predict.keep` asks for it.
        settings: of the task.
    """
    least = settings.least_confidence or 0.0
    if settings.keep is not None:
        values = np.concatenate([np.empty(0, np.float32), *(known[known > 0] for known in maps)])
        quantile = float(np.quantile(values, 1.0 - settings.keep)) if values.size else 1.0
        least = max(least, quantile, float(np.finfo(np.float32).tiny))
    return least


def _confirmed(
    results: PredictionFolder, reader: Reader, frames: Sequence[FrameReference], settings: PredictSettings
) -> Callable[[FrameReference], np.ndarray | None]:
    """Which pixels of a frame of a sequence may become points; None for all."""
    if settings.agreement is None or not (settings.cloud_formats or settings.viewer):
        return lambda frame: None
    return AgreementFilter(results, reader, frames, settings.agreement)


def _least_confidence(results: PredictionFolder, frames: Sequence[FrameReference], settings: PredictSettings) -> float:
    maps = (results.read_confidence(frame)[::_SAMPLED, ::_SAMPLED] for frame in frames)
    return least_confidence(maps, settings)


def _depth_range(results: PredictionFolder, frames: Sequence[FrameReference]) -> tuple[float, float]:
    """The ends of the colours of a sequence: the medians of the frames' own would flicker, their extremes flatten."""
    records: Mapping[FrameReference, tuple[float, float, float]] = {
        frame: results.records[frame].depth for frame in frames
    }
    nearest, _, farthest = zip(*records.values(), strict=True)
    return float(np.percentile(nearest, 10)), float(np.percentile(farthest, 90))
