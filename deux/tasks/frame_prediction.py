"""`task=predict` for a single frame: reads the user's files and writes the completed depth to the run folder."""

import logging
from pathlib import Path

import numpy as np

from deux.configuration import run_folder, user_path
from deux.contracts import DepthModel, Uncertainty
from deux.data.frame_stream import RecordedFrame
from deux.errors import DeuxError, image_size, plural
from deux.figures.depth_figures import draw_depth
from deux.figures.drawing import save_figure
from deux.figures.viewer_recording import PredictionRecording
from deux.geometry.camera import Camera
from deux.io.atomic import make_folder, write_atomically
from deux.io.calibration import camera_warning
from deux.io.camera_files import read_any_depth, read_any_image, read_any_intrinsics
from deux.io.cloud_files import write_cloud
from deux.io.images import LARGEST_DEPTH, encode_depth, encode_fraction
from deux.report.results import error_table
from deux.tasks.console import say
from deux.tasks.depth_completion import CompletedDepth, DepthCompleter, unusable_measure
from deux.tasks.predict_settings import PredictSettings
from deux.tasks.prediction_checks import DepthFiles, check_units, errors_beside_interpolation, unseen_truth
from deux.tasks.prediction_export import check_not_empty, frame_cloud, least_confidence
from deux.tasks.prediction_folder import encode_array

log = logging.getLogger(__name__)


def predict_frame(
    settings: PredictSettings, name: str, model: DepthModel, measure: Uncertainty | None, camera: Camera
) -> None:
    """Complete the depth of a single frame and write it; a repeated command overwrites its files.

    With ground truth, the errors are printed beside those of interpolation, if there are points to interpolate.

    Args:
        settings: the section `predict`.
        name: name of the model.
        model: the depth model.
        measure: uncertainty measure; None for no confidence.
        camera: its depth range limits the ground truth that is compared.

    Raises:
        DeuxError: a file is wrong, or the measure needs several frames.
    """
    if measure is not None and measure.needs_sources:
        raise unusable_measure(str(settings.uncertainty), "predict.image is one frame")
    frame = read_single_frame(settings)
    truth_file = settings.ground_truth and str(settings.ground_truth)
    check_units(frame, model, DepthFiles(str(settings.sparse), settings.sparse_scale, truth_file))
    truth = unseen_truth(frame, camera)
    if truth is None and frame.ground_truth is not None:
        raise DeuxError(
            f"predict.ground_truth={settings.ground_truth} has no pixel between {camera.min_depth:g} and "
            f"{camera.max_depth:g} m apart from the sparse points: give another file, or widen camera.min_depth and "
            "camera.max_depth."
        )
    (completed,) = DepthCompleter(model, measure, settings.corrected)([frame])
    depth = completed.depth
    for path in (*write_prediction(completed, run_folder()), *_export(frame, completed, settings, run_folder())):
        say(str(path))
    nearest, median, farthest = np.percentile(depth, (0, 50, 100))
    size = image_size(depth.shape)
    say(f"Depth from {nearest:.2f} to {farthest:.2f} m, median {median:.2f} m, at {size} pixels")
    if truth is not None:
        own, interpolated = errors_beside_interpolation(depth, frame, truth, camera)
        rows = {name: own} | ({"interpolated points": interpolated} if interpolated else {})
        pixels = np.count_nonzero(truth)
        say(error_table(f"Errors on the {pixels:,} pixels with ground truth that are not sparse points", rows))


def read_single_frame(settings: PredictSettings) -> RecordedFrame:
    """Read the files of one frame.

    Raises:
        DeuxError: a file is not given, missing, damaged or of the wrong type, or the sizes differ.
    """
    given = {"image": settings.image, "sparse": settings.sparse, "intrinsics": settings.intrinsics}
    paths = {option: user_path(path) for option, path in given.items() if path}
    if missing := [option for option in given if option not in paths]:
        raise DeuxError(
            "task=predict needs the files of one frame, predict.image=, predict.sparse= and predict.intrinsics=, or "
            f"many frames, predict.data=: {' and '.join(missing)} {plural('is', len(missing))} not given."
        )
    for option, path in paths.items():
        if path.is_dir():
            raise DeuxError(
                f"predict.{option}={given[option]} is a folder, and the file of one frame is expected: use "
                "predict.data= for a folder of frames."
            )
    image = read_any_image(paths["image"])
    sparse_depth = read_any_depth(paths["sparse"], settings.sparse_scale)
    intrinsics = read_any_intrinsics(paths["intrinsics"])
    truth_scale = settings.ground_truth_scale or settings.sparse_scale
    truth = read_any_depth(user_path(settings.ground_truth), truth_scale) if settings.ground_truth else None
    for option, depth in (("sparse", sparse_depth), ("ground_truth", truth)):
        if depth is not None and depth.shape != image.shape[:2]:
            raise DeuxError(
                f"predict.image has {image_size(image.shape)} pixels and predict.{option} {image_size(depth.shape)}: "
                "they must have the same size."
            )
    if sentence := camera_warning(intrinsics, image.shape[0], image.shape[1], str(paths["intrinsics"])):
        log.warning(sentence)
    return RecordedFrame(image, sparse_depth, intrinsics, truth)


def write_prediction(completed: CompletedDepth, folder: Path) -> list[Path]:
    """Write a frame's depth as `depth.png` (16 bits, metres x 256), `depth.npy` (float32) and `depth_colored.png`.

    Confidence, if there is any, is written as `confidence.png` (16 bits, x 65535) and `confidence.npy` (float32).

    Returns:
        The files.
    """
    make_folder(folder)
    depth, confidence = completed.depth, completed.confidence
    png, npy, colored = (folder / name for name in ("depth.png", "depth.npy", "depth_colored.png"))
    if depth.max() > LARGEST_DEPTH:
        log.warning(f"{png} is 0 where the depth is above {LARGEST_DEPTH:.0f} m: {npy} contains these depths as well.")
    files = {png: encode_depth(depth), npy: encode_array(depth)}
    if confidence is not None:
        files |= {
            folder / "confidence.png": encode_fraction(confidence),
            folder / "confidence.npy": encode_array(confidence),
        }
    for path, content in files.items():
        write_atomically(path, content)
    save_figure(draw_depth(depth, confidence), colored)
    return [png, npy, colored, *list(files)[2:]]


def _export(frame: RecordedFrame, completed: CompletedDepth, settings: PredictSettings, folder: Path) -> list[Path]:
    """Write the point cloud, in camera axes, and the recording, if they are configured."""
    written = []
    least = 0.0 if completed.confidence is None else least_confidence(iter([completed.confidence]), settings)
    cloud = frame_cloud(frame, completed, least)
    for suffix in settings.cloud_formats:
        path = folder / f"cloud.{suffix}"
        check_not_empty(cloud, path)
        write_cloud(path, cloud, camera_axes=True)
        written.append(path)
    if settings.viewer:
        path = folder / "recording.rrd"
        depths = completed.depth[completed.depth > 0]
        nearest, farthest = np.percentile(depths, (1, 99)) if depths.size else (0.0, 1.0)
        with PredictionRecording(path, "frame", (float(nearest), float(farthest))) as recording:
            recording.add(0, str(settings.image), frame, completed.depth, completed.confidence, cloud)
        written.append(path)
    return written
