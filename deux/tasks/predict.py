"""`task=predict`: complete the depth of one frame, from files and to files."""

import io
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of, user_path
from deux.contracts import DepthModel
from deux.data.depth_unit import ratio_warning, unit_warning
from deux.deployment.array_prediction import predict_arrays
from deux.errors import DeuxError, check_range
from deux.figures.depth_figures import draw_depth
from deux.figures.drawing import save_figure
from deux.geometry.camera import Camera
from deux.geometry.scaffolding import interpolate
from deux.io.atomic import make_folder, write_atomically
from deux.io.calibration import camera_warning
from deux.io.camera_files import ARRAY_SUFFIX, read_any_depth, read_any_image, read_any_intrinsics
from deux.io.images import LARGEST_DEPTH, write_depth
from deux.metrics.depth_errors import depth_errors
from deux.report.results import error_table
from deux.tasks.checkpoints import load_needed_model
from deux.tasks.console import quieten_libraries, say

MANY = 0.1
"""From this part of the points on, it is said that they lie where the model predicts no depth."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PredictSettings:
    """The model, and the files of the frame whose depth it completes.

    Args:
        checkpoint: a run folder, a model file or the model's published checkpoint.
        image: an 8-bit image.
        sparse: depth of some pixels, as a 16-bit PNG or .npy file.
        sparse_scale: stored values per metre in PNG files.
        intrinsics: a text or .npy file.
        ground_truth: depth to compare with, as `sparse`.
        ground_truth_scale: stored values per metre in its PNG file; None for `sparse_scale`.

    Raises:
        DeuxError: a value is out of its range.
    """

    checkpoint: str | None
    image: str | None
    sparse: str | None
    sparse_scale: float
    intrinsics: str | None
    ground_truth: str | None
    ground_truth_scale: float | None

    def __post_init__(self) -> None:
        check_range("predict.sparse_scale", self.sparse_scale, 0, ends=False)
        if self.ground_truth_scale is not None:
            check_range("predict.ground_truth_scale", self.ground_truth_scale, 0, ends=False)


@dataclass(frozen=True)
class RecordedFrame:
    """What the user's files hold.

    Args:
        image: H x W x 3 uint8.
        sparse_depth: H x W float32 metres, 0 = none.
        intrinsics: 3 x 3.
        ground_truth: H x W float32 metres, 0 = none; None if no file was given.
    """

    image: np.ndarray
    sparse_depth: np.ndarray
    intrinsics: np.ndarray
    ground_truth: np.ndarray | None


def run(cfg: DictConfig) -> None:
    """Complete the depth of a frame by the model `predict.checkpoint`, in float32, and write it to the run folder.

    With ground truth, its errors are printed beside those of interpolation, where there are points to interpolate. A
    repeated command overwrites its files.
    """
    quieten_libraries()
    sections = sections_of(cfg)
    settings, camera = sections.read("predict", PredictSettings), sections.read("camera", Camera)
    frame = read_frame(settings)
    name, model = load_needed_model(sections.plugin("model"), settings.checkpoint, "predict.checkpoint")
    check_units(frame, model, settings)
    truth = None if frame.ground_truth is None else unseen(frame, camera)
    depth = predict_arrays(frame.image, frame.sparse_depth, frame.intrinsics, model)
    for path in write_prediction(depth, run_folder()):
        say(str(path))
    nearest, median, farthest = np.percentile(depth, (0, 50, 100))
    say(f"Depth from {nearest:.2f} to {farthest:.2f} m, {median:.2f} m in the median, at {_size(depth)} pixels")
    if truth is not None:
        maps = {name: depth}
        if frame.sparse_depth.any():  # without points there is nothing to interpolate
            maps["interpolated points"] = interpolate(frame.sparse_depth)
        rows = {row: _errors(predicted, truth, camera) for row, predicted in maps.items()}
        counted = np.count_nonzero(truth)
        say(error_table(f"Errors on the {counted:,} pixels with ground truth that are no sparse points", rows))


def read_frame(chosen: PredictSettings) -> RecordedFrame:
    """Read the files of one frame.

    Raises:
        DeuxError: a file is not given, missing, damaged or of another kind, or the sizes differ.
    """
    given = {"image": chosen.image, "sparse": chosen.sparse, "intrinsics": chosen.intrinsics}
    paths = {option: user_path(path) for option, path in given.items() if path}
    if missing := [option for option in given if option not in paths]:
        raise DeuxError(
            "task=predict needs the files of one frame, predict.image=, predict.sparse= and predict.intrinsics=: "
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} not given."
        )
    image = read_any_image(paths["image"])
    sparse_depth = read_any_depth(paths["sparse"], chosen.sparse_scale)
    intrinsics = read_any_intrinsics(paths["intrinsics"])
    truth_scale = chosen.ground_truth_scale or chosen.sparse_scale
    truth = read_any_depth(user_path(chosen.ground_truth), truth_scale) if chosen.ground_truth else None
    for option, depth in (("sparse", sparse_depth), ("ground_truth", truth)):
        if depth is not None and depth.shape != image.shape[:2]:
            raise DeuxError(f"image has {_size(image)} pixels and {option} {_size(depth)}: they must be of one size.")
    if sentence := camera_warning(intrinsics, image.shape[0], image.shape[1], str(paths["intrinsics"])):
        log.warning(sentence)
    return RecordedFrame(image, sparse_depth, intrinsics, truth)


def check_units(frame: RecordedFrame, model: DepthModel, chosen: PredictSettings) -> None:
    """Say so if there are no points, or if their values or those of the ground truth look like another unit's.

    Raises:
        DeuxError: all points lie outside the range of depths that the model predicts.
    """
    points = frame.sparse_depth[frame.sparse_depth > 0]
    if not points.size:
        log.warning(f"{chosen.sparse} holds no point, all its values are 0: the depth comes from the image alone.")
        return
    outside = float(np.mean((points < model.min_depth) | (points > model.max_depth)))
    found = [_other_unit(points, model, chosen) if outside < MANY else _range_warning(points, outside, model, chosen)]
    if outside == 1:
        raise DeuxError(str(found[0]))
    if frame.ground_truth is not None:
        what = str(chosen.ground_truth)
        found.append(ratio_warning(frame.ground_truth, frame.sparse_depth, what, "predict.ground_truth_scale"))
    for sentence in found:
        if sentence is not None:
            log.warning(sentence)


def _other_unit(points: np.ndarray, model: DepthModel, chosen: PredictSettings) -> str | None:
    """The sentence for points of a PNG file within the model's range that are likely to be in another unit."""
    if str(chosen.sparse).endswith(ARRAY_SUFFIX):
        return None
    return unit_warning(points, chosen.sparse_scale, model.max_depth, str(chosen.sparse), "predict.sparse_scale")


def _range_warning(points: np.ndarray, outside: float, model: DepthModel, chosen: PredictSettings) -> str:
    """The sentence for points of which the part `outside` lies where the model predicts no depth."""
    share = "all" if outside == 1 else f"{outside:.0%} of the"
    return (
        f"{share} {points.size:,} points of {chosen.sparse} lie outside the {model.min_depth:g} to {model.max_depth:g} "
        f"m that the model predicts (they go from {points.min():g} to {points.max():g} m): is their unit right? A PNG "
        f"file holds predict.sparse_scale={chosen.sparse_scale:g} values per metre; it is 1000 for millimetres."
    )


def unseen(frame: RecordedFrame, camera: Camera) -> np.ndarray:
    """The ground truth that is compared with: within the camera's range, and not given to the model as sparse points.

    Returns:
        H x W float32 metres, 0 = none.

    Raises:
        DeuxError: no pixel is left.
    """
    truth = frame.ground_truth
    assert truth is not None
    counted = (truth > camera.min_depth) & (truth < camera.max_depth) & (frame.sparse_depth == 0)
    if not counted.any():
        raise DeuxError(
            f"ground_truth has no pixel between {camera.min_depth:g} and {camera.max_depth:g} m apart from the sparse "
            "points: name another file, or widen camera.min_depth and camera.max_depth."
        )
    return np.where(counted, truth, np.float32(0))


def write_prediction(depth: np.ndarray, folder: Path) -> list[Path]:
    """Write H x W metres as `depth.png` (16 bits, metres x 256), `depth.npy` (float32) and `depth_colored.png`.

    Returns:
        The files.
    """
    make_folder(folder)
    png, npy, colored = (folder / name for name in ("depth.png", "depth.npy", "depth_colored.png"))
    if depth.max() > LARGEST_DEPTH:
        log.warning(f"{png} holds 0 where the depth is above {LARGEST_DEPTH:.0f} m: {npy} holds all of it.")
    write_depth(png, depth)
    content = io.BytesIO()
    np.save(content, depth, allow_pickle=False)
    write_atomically(npy, content.getvalue())
    save_figure(draw_depth(depth), colored)
    return [png, npy, colored]


def _errors(depth: np.ndarray, truth: np.ndarray, camera: Camera) -> dict[str, float]:
    """The four errors of H x W metres."""
    predicted, known = (torch.from_numpy(values)[None, None] for values in (depth, truth))
    errors = depth_errors(predicted, known, camera.min_depth, camera.max_depth)
    return {name: value.item() for name, value in errors.items()}


def _size(pixels: np.ndarray) -> str:
    height, width = pixels.shape[:2]
    return f"{width} x {height}"
