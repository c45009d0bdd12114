"""`task=predict` for many frames: predicts them in batches, resumable, then evaluates and exports them."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from deux.configuration import run_folder, user_path
from deux.contracts import DepthModel, FrameReference, Reader, Uncertainty
from deux.data.checked_frames import pose_of, triplets_of
from deux.data.chosen_sources import sources_by_parallax
from deux.data.frame_stream import FrameStream, RecordedFrame
from deux.data.loose_frames import LooseFrames
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.calibration import camera_warning
from deux.io.images import LARGEST_DEPTH
from deux.metrics.depth_errors import METRICS
from deux.report.results import error_table
from deux.task_sections import Sections
from deux.tasks.checkpoints import pretrained_identity, weights_identity
from deux.tasks.console import progress, say
from deux.tasks.depth_completion import CompletedDepth, DepthCompleter, batches, unusable_measure
from deux.tasks.predict_settings import PredictSettings
from deux.tasks.prediction_checks import DepthFiles, check_units, errors_beside_interpolation, unseen_truth
from deux.tasks.prediction_export import export_sequences
from deux.tasks.prediction_folder import FrameRecord, PredictionFolder
from deux.tasks.recorded_frames import check_frames, data_digest, make_reader
from deux.tasks.run_folder import open_run_folder

log = logging.getLogger(__name__)


def predict_sequences(
    sections: Sections, settings: PredictSettings, name: str, model: DepthModel, measure: Uncertainty | None
) -> None:
    """Complete the depth of all frames of `predict.data` and write them to the run folder.

    Frames that an earlier attempt of the same command completed are not repeated. Afterwards, videos, point clouds and
    recordings are exported from the files and, if there is ground truth, the mean errors are printed together with
    those of interpolation.

    Args:
        sections: configuration; reads `camera` and `data`.
        settings: the section `predict`.
        name: name of the model.
        model: the depth model.
        measure: uncertainty measure; None for no confidence.

    Raises:
        DeuxError: a file is wrong, or poses are needed and missing.
    """
    camera = sections.read("camera", Camera)
    reader, frames = requested_frames(sections, settings)
    posed = _posed(settings, measure, reader, frames)
    choice, path = sections.plugin("model"), settings.checkpoint
    weights = weights_identity(path) if path else pretrained_identity(choice, model)
    identity = sections.identity | {"weights": weights}
    files = data_digest(reader, "predict.data", sections)
    with open_run_folder(run_folder(), identity, files=files) as run:
        results = PredictionFolder(run.path, settings.format)
        todo = [frame for frame in frames if frame not in results.records]
        earlier = f", {len(frames) - len(todo)} of them done before" if len(todo) < len(frames) else ""
        say(f"Predict {len(frames)} frames of {reader.folder} with {name}{earlier}")
        if todo:
            _check_frames(reader, todo, model, settings)
            sources = sources_by_parallax(reader, posed) if measure and measure.needs_sources else None
            with run.stage("predict"):
                completer = DepthCompleter(model, measure, settings.corrected)
                _predict(todo, results, FrameStream(reader, sources), completer, settings, camera)
        with run.stage("export"), progress() as report:
            written = export_sequences(results, reader, frames, settings, report)
        _summarise(results, frames, name, written)


def _predict(
    todo: Sequence[FrameReference],
    results: PredictionFolder,
    stream: FrameStream,
    completer: DepthCompleter,
    settings: PredictSettings,
    camera: Camera,
) -> None:
    """Predict the frames `todo` in batches and write each batch to `results`."""
    clipped, earlier = 0, len(results.records)
    with progress() as report:
        for batch in batches(stream(todo), settings.batch_size):
            completed = completer([frame for _, frame in batch])
            results.write(
                [
                    (reference, result, _record(reference, frame, result, camera))
                    for (reference, frame), result in zip(batch, completed, strict=True)
                ]
            )
            clipped += sum(bool(result.depth.max() > LARGEST_DEPTH) for result in completed)
            report("prediction", len(results.records), earlier + len(todo))
    if clipped and settings.format == "png":
        log.warning(
            f"{clipped} depth files are 0 where the depth is above {LARGEST_DEPTH:.0f} m: predict.format=npy stores "
            "these depths as well."
        )


def requested_frames(sections: Sections, settings: PredictSettings) -> tuple[Reader, list[FrameReference]]:
    """The reader of `predict.data`, and its frames of `predict.split` in temporal order.

    Raises:
        DeuxError: options contradict each other, or there are no frames.
    """
    assert settings.data is not None
    if settings.image is not None:
        raise DeuxError("predict.image is one frame and predict.data many: give one of the two.")
    if settings.sparse is None:
        if settings.intrinsics or settings.ground_truth:
            raise DeuxError(
                f"predict.intrinsics and predict.ground_truth are used with predict.sparse= only, and {settings.data} "
                f"is read by data={sections.plugin('data').name}, which has its own: leave them out, or set "
                "predict.sparse=."
            )
        reader = make_reader(sections, settings.data)
    else:
        reader = _loose_frames(settings)
    if settings.split == "all" or settings.sparse is not None:
        return reader, reader.frames()
    return reader, [target for target, _ in triplets_of(reader, settings.split, (-1,))]


def _loose_frames(settings: PredictSettings) -> LooseFrames:
    assert settings.data is not None
    assert settings.sparse is not None
    if settings.intrinsics is None:
        raise DeuxError(
            f"predict.intrinsics= is missing: with predict.sparse=, {settings.data} is a folder of images or a video, "
            "which needs the file of its camera matrix."
        )
    return LooseFrames(
        user_path(settings.data),
        user_path(settings.sparse),
        user_path(settings.intrinsics),
        settings.sparse_scale,
        user_path(settings.ground_truth) if settings.ground_truth else None,
        settings.ground_truth_scale,
    )


def _posed(
    settings: PredictSettings, measure: Uncertainty | None, reader: Reader, frames: Sequence[FrameReference]
) -> list[FrameReference]:
    """The frames that have a pose; empty if poses are not needed.

    Raises:
        DeuxError: poses are needed, and no frame has one.
    """
    needs_sources = measure is not None and measure.needs_sources
    if not (needs_sources or settings.cloud_formats):
        return []
    posed = [frame for frame in frames if pose_of(reader, frame) is not None]
    if not posed and needs_sources:
        raise unusable_measure(str(settings.uncertainty), f"{reader.folder} has no poses")
    if not posed:
        raise DeuxError(
            f"predict.export={settings.cloud_formats[0]} fuses the frames by their poses, and {reader.folder} has "
            "none: leave it out, or give a single frame with predict.image=."
        )
    return posed


def _check_frames(
    reader: Reader, frames: Sequence[FrameReference], model: DepthModel, settings: PredictSettings
) -> None:
    """Warn if depth seems to be in a wrong unit, or intrinsics seem to be of images of another size."""
    if not isinstance(reader, LooseFrames):
        check_frames(reader, frames, model)
        return
    first = FrameStream(reader).read(frames[0])
    truth = settings.ground_truth and str(settings.ground_truth)
    check_units(first, model, DepthFiles(str(settings.sparse), settings.sparse_scale, truth))
    height, width = first.sparse_depth.shape
    if warning := camera_warning(first.intrinsics, height, width, str(settings.intrinsics)):
        log.warning(warning)


def _record(reference: FrameReference, frame: RecordedFrame, completed: CompletedDepth, camera: Camera) -> FrameRecord:
    nearest, median, farthest = (float(value) for value in np.percentile(completed.depth, (1, 50, 99)))
    truth = unseen_truth(frame, camera)
    if truth is None:
        return FrameRecord(*reference, (nearest, median, farthest))
    errors, interpolated = errors_beside_interpolation(completed.depth, frame, truth, camera)
    return FrameRecord(*reference, (nearest, median, farthest), int(np.count_nonzero(truth)), errors, interpolated)


def _summarise(results: PredictionFolder, frames: Sequence[FrameReference], name: str, written: Sequence[Path]) -> None:
    """Print the output files, and the mean errors of the frames with ground truth and sparse points."""
    errors = results.write_errors(frames)
    folders = [results.folder / kind for kind in ("depth", "confidence") if (results.folder / kind).is_dir()]
    for path in (*folders, *written, *([] if errors is None else [errors])):
        say(str(path))
    records = [record for frame in frames if (record := results.records[frame]).errors]
    if not records:
        return
    compared = [record for record in records if record.interpolated]
    rows = {name: _means([record.errors for record in compared or records])}
    if compared:
        rows["interpolated points"] = _means([record.interpolated for record in compared])
    left_out = len(records) - len(compared)
    notes = (f"{left_out} frames without points are left out.",) if compared and left_out else ()
    caption = (
        f"Mean errors of {len(compared or records)} frames on the pixels with ground truth that are not sparse points"
    )
    say(error_table(caption, rows, notes))


def _means(errors: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {metric: float(np.mean([frame[metric] for frame in errors])) for metric in METRICS}
