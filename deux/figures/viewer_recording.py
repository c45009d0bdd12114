"""Recordings of predicted frames for the Rerun viewer: `rerun FILE.rrd` (pip install "deux[viewer]")."""

import os
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from deux.data.frame_stream import RecordedFrame
from deux.errors import DeuxError, error_text
from deux.figures.depth_video import color_map
from deux.figures.drawing import DEPTH_COLORS
from deux.geometry.point_cloud import PointCloud
from deux.io.atomic import make_folder

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

FRAME_TIMELINE = "frame"
"""Name of the viewer's time line, the frame number."""

_MOST_POINTS = 20_000
"""Maximum number of points that each frame adds to the cloud."""

_JPEG_QUALITY = 85


def check_viewer(option: str) -> None:
    """Raise DeuxError if the package for recordings, which `option` requires, is not installed."""
    if find_spec("rerun") is None:
        raise DeuxError(f'{option}=rerun needs the package rerun-sdk: install it with pip install "deux[viewer]".')


class ViewerFile:
    """An .rrd file that is written atomically. A context manager.

    Args:
        path: the file.
        name: name of the recording in the viewer.
        layout: layout of the viewer, from `rerun.blueprint`.
    """

    def __init__(self, path: Path, name: str, layout: "Blueprint") -> None:
        self.path = path
        self._unfinished = path.with_name(f".{path.name}.tmp")
        make_folder(path.parent)
        rerun = rerun_package()
        self.stream: RecordingStream = rerun.RecordingStream("deux", recording_id=str(path))
        """The stream for logging."""
        try:
            self.stream.save(self._unfinished, default_blueprint=layout)
            self.stream.send_recording_name(name)
        except Exception as error:  # raised by Rust code, currently a RuntimeError
            raise DeuxError(f"{path} cannot be written: {error_text(error)}.") from error

    def __enter__(self) -> "ViewerFile":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self.stream.flush()
            self.stream.disconnect()
            if kind is None:
                os.replace(self._unfinished, self.path)
        except Exception as error:  # as above; its message does not include the cause
            if kind is None:  # otherwise the earlier error is raised
                raise DeuxError(f"{self.path} cannot be written, the disk may be full: {error_text(error)}.") from error
        finally:
            with suppress(OSError):
                self._unfinished.unlink()


class PredictionRecording:
    """Recording of a sequence: camera, image, sparse points, depth, confidence and point cloud over time.

        world                      world coordinates, y up
        world/camera               pose and intrinsics of the camera
        world/camera/image         the colour image
        world/camera/sparse        the sparse points, coloured by depth
        world/cloud/<number>       the points of each frame, which accumulate over time
        depth, confidence          H x W maps, in millimetres and in units of 1/255
        frame_name                 name of the frame as text

    Without poses, the camera is at the origin and only the current frame's points are shown.

    Args:
        path: the .rrd file.
        name: name of the sequence.
        depth_range: limits of the colour scale of depth, metres.
    """

    def __init__(self, path: Path, name: str, depth_range: tuple[float, float]) -> None:
        self.path = path
        self._range = depth_range
        self._rerun: Any = rerun_package()
        self._file = ViewerFile(path, name, _layout())
        self._log("world", self._rerun.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)

    def __enter__(self) -> "PredictionRecording":
        self._file.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *details: object) -> None:
        self._file.__exit__(kind, *details)

    def add(
        self,
        number: int,
        name: str,
        frame: RecordedFrame,
        depth: np.ndarray,
        confidence: np.ndarray | None,
        cloud: PointCloud,
    ) -> None:
        """Record a frame.

        Args:
            number: index of the frame, from 0.
            name: name of the frame.
            frame: the recorded frame.
            depth: predicted depth, H x W metres.
            confidence: H x W in [0, 1]; None for no confidence.
            cloud: points of the frame, in world coordinates if it has a pose.
        """
        rerun = self._rerun
        self._file.stream.set_time(FRAME_TIMELINE, sequence=number)
        self._log("frame_name", rerun.TextLog(name))
        height, width = depth.shape
        pose = np.eye(4) if frame.pose is None else frame.pose
        self._log(
            "world/camera",
            rerun.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]),
            rerun.Pinhole(
                image_from_camera=frame.intrinsics,
                resolution=[width, height],
                camera_xyz=rerun.ViewCoordinates.RDF,
                image_plane_distance=0.3,
            ),
        )
        self._log("world/camera/image", rerun.Image(frame.image).compress(jpeg_quality=_JPEG_QUALITY))
        rows, columns = np.nonzero(frame.sparse_depth)
        colors = color_map(frame.sparse_depth[rows, columns][None], self._range, DEPTH_COLORS)[0]
        pixels = np.stack([columns, rows], axis=1) + 0.5  # Rerun's pixel centres lie at halves
        self._log("world/camera/sparse", rerun.Points2D(pixels, colors=colors, radii=1.5))
        millimetres = np.clip(np.rint(1000.0 * np.nan_to_num(depth)), 0, 65535).astype(np.uint16)
        ends = [1000.0 * end for end in self._range]
        self._log("depth", rerun.DepthImage(millimetres, meter=1000.0, colormap="turbo", depth_range=ends))
        if confidence is not None:
            parts = np.rint(255.0 * confidence).astype(np.uint8)
            self._log("confidence", rerun.DepthImage(parts, meter=255.0, colormap="viridis", depth_range=[0, 255]))
        place = f"world/cloud/{0 if frame.pose is None else number}"
        kept = slice(None, None, max(1, len(cloud.points) // _MOST_POINTS))
        self._log(place, rerun.Points3D(cloud.points[kept], colors=cloud.colors[kept], radii=0.01))

    def _log(self, place: str, *parts: Any, static: bool = False) -> None:
        self._file.stream.log(place, *parts, static=static)


def rerun_package() -> ModuleType:
    """Import rerun, which takes seconds; call `check_viewer` first."""
    import rerun

    return rerun


def _layout() -> "Blueprint":
    """Viewer layout: the cloud on the left, the maps in a column on the right."""
    from rerun import blueprint

    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Spatial3DView(origin="world", name="cloud"),
            blueprint.Vertical(
                blueprint.Spatial2DView(origin="world/camera", contents="world/camera/**", name="image and points"),
                blueprint.Spatial2DView(origin="depth", name="depth"),
                blueprint.Spatial2DView(origin="confidence", name="confidence"),
            ),
            column_shares=[2, 1],
        ),
        collapse_panels=True,
    )
