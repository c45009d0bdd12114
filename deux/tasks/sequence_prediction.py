"""Many frames of `task=predict`: streamed through the model in batches, resumed after a kill, compared and exported."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from deux.configuration import run_folder, user_path
from deux.contracts import DepthModel, FrameReference, Reader, Uncertainty
from deux.data.chosen_sources import read_triplets, sources_by_parallax
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
from deux.tasks.depth_completion import CompletedDepth, DepthCompleter, batches, refuse_measure
from deux.tasks.predict_settings import PredictSettings
from deux.tasks.prediction_checks import DepthFiles, check_units, errors_beside_interpolation, unseen_truth
from deux.tasks.prediction_export import export_sequences
from deux.tasks.prediction_folder import FrameRecord, PredictionFolder
from deux.tasks.recorded_frames import check_frames, given_files, read_given
from deux.tasks.run_folder import open_run_folder

log = logging.getLogger(__name__)


def predict_sequences(
    sections: Sections, settings: PredictSettings, name: str, model: DepthModel, measure: Uncertainty | None
) -> None:
    """Complete the depth of all frames of `predict.data` and write them to the run folder.

    A frame that an earlier start of the same command has done is not done again. Then the videos, clouds and recordings
    are made from the files, and the mean errors printed beside those of interpolation where there is ground truth.

    Args:
        sections: of these it reads `camera` and `data`.
        settings: the section `predict`.
        name: of the model.
        model: the depth model.
        measure: of uncertainty; None for none.

    Raises:
        DeuxError: a file is wrong, or frames without poses are asked for what needs poses.
    """
    camera = sections.read("camera", Camera)
    reader, frames = given_frames(sections, settings)
    posed = _posed(settings, measure, reader, frames)
    chosen, path = sections.plugin("model"), settings.checkpoint
    weights = weights_identity(path) if path else pretrained_identity(chosen, model)
    identity = sections.identity | {"weights": weights}
    files = given_files(reader, "predict.data", sections)
    with open_run_folder(run_folder(), identity, files=files) as run:
        results = PredictionFolder(run.path, settings.format)
        todo = [frame for frame in frames if frame not in results.records]
        earlier = f", {len(frames) - len(todo)} of them before" if len(todo) < len(frames) else ""
        say(f"Predict {len(frames)} frames of {reader.folder} with {name}{earlier}")
        if todo:
            _check_frames(reader, todo, model, settings)
        with run.stage("predict"), progress() as report:
            sources = sources_by_parallax(reader, posed) if todo and measure and measure.needs_sources else None
            stream = FrameStream(reader, sources)
            completion = DepthCompleter(model, measure)
            beyond, done = 0, len(frames) - len(todo)
            for batch in batches(stream(todo), settings.batch_size):
                completed = completion([frame for _, frame in batch])
                together = list(zip(batch, completed, strict=True))
                results.write([(name, one, _record(name, frame, one, camera)) for (name, frame), one in together])
                beyond += sum(bool(one.depth.max() > LARGEST_DEPTH) for one in completed)
                done += len(batch)
                report("prediction", done, len(frames))
        if beyond and settings.format == "png":
            log.warning(
                f"{beyond} depth files hold 0 where the depth is above {LARGEST_DEPTH:.0f} m: predict.format=npy "
                "holds all of it."
            )
        with run.stage("export"), progress() as report:
            written = export_sequences(results, reader, frames, settings, report)
        _summarise(results, frames, name, written)


def given_frames(sections: Sections, settings: PredictSettings) -> tuple[Reader, list[FrameReference]]:
    """The reader of `predict.data`, and the frames of it that are asked for, in the order of time.

    Raises:
        DeuxError: options contradict each other, or there are no frames.
    """
    assert settings.data is not None
    if settings.image is not None:
        raise DeuxError("predict.image names one frame and predict.data many: give one of the two.")
    if settings.sparse is None:
        if settings.intrinsics or settings.ground_truth:
            raise DeuxError(
                f"predict.intrinsics and predict.ground_truth belong to images beside a folder of points, "
                f"predict.sparse=: {settings.data} is read as data={sections.plugin('data').name}, which finds its own."
            )
        reader = read_given(sections, settings.data)
    else:
        reader = _loose(settings)
    if settings.split == "all" or settings.sparse is not None:
        return reader, reader.frames()
    return reader, [target for target, _ in read_triplets(reader, settings.split, (-1,))]


def _loose(settings: PredictSettings) -> LooseFrames:
    assert settings.data is not None
    assert settings.sparse is not None
    if settings.intrinsics is None:
        raise DeuxError(
            f"predict.sparse says that {settings.data} is a folder of images or a video: predict.intrinsics= names the "
            "file of its camera matrix."
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
    """The frames that have a pose, where poses are needed.

    Raises:
        DeuxError: they are needed, and there is none.
    """
    compares = measure is not None and measure.needs_sources
    if not (compares or settings.cloud_formats):
        return []
    posed = [frame for frame in frames if reader.pose(frame) is not None]
    if not posed and compares:
        raise refuse_measure(str(settings.uncertainty), f"{reader.folder} has no poses")
    if not posed:
        raise DeuxError(
            f"predict.export={settings.cloud_formats[0]} fuses the frames by their poses, and {reader.folder} has "
            "none: leave it out, or name one frame by predict.image=."
        )
    return posed


def _check_frames(
    reader: Reader, frames: Sequence[FrameReference], model: DepthModel, settings: PredictSettings
) -> None:
    """Warn of depth in a likely other unit and of intrinsics of images of another size."""
    if not isinstance(reader, LooseFrames):
        check_frames(reader, frames, model)
        return
    first = FrameStream(reader).read(frames[0])
    truth = settings.ground_truth and str(settings.ground_truth)
    check_units(first, model, DepthFiles(str(settings.sparse), settings.sparse_scale, truth))
    height, width = first.sparse_depth.shape
    if sentence := camera_warning(first.intrinsics, height, width, str(settings.intrinsics)):
        log.warning(sentence)


def _record(reference: FrameReference, frame: RecordedFrame, completed: CompletedDepth, camera: Camera) -> FrameRecord:
    nearest, median, farthest = (float(value) for value in np.percentile(completed.depth, (1, 50, 99)))
    truth = unseen_truth(frame, camera)
    if truth is None:
        return FrameRecord(*reference, (nearest, median, farthest))
    own, interpolated = errors_beside_interpolation(completed.depth, frame, truth, camera)
    return FrameRecord(*reference, (nearest, median, farthest), int(np.count_nonzero(truth)), own, interpolated)


def _summarise(results: PredictionFolder, frames: Sequence[FrameReference], name: str, written: Sequence[Path]) -> None:
    """Print where the results lie, and the mean errors of the frames that have ground truth and points."""
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
        f"Mean errors of {len(compared or records)} frames on the pixels with ground truth that are no sparse points"
    )
    say(error_table(caption, rows, notes))


def _means(errors: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {metric: float(np.mean([one[metric] for one in errors])) for metric in METRICS}
