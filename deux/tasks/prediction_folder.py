"""The predictions of many frames: a depth file for each, and a journal of the completed frames."""

import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from deux.contracts import FrameReference
from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_atomically, write_failure
from deux.io.camera_files import read_any_depth
from deux.io.file_names import check_frame_path, is_frame_path
from deux.io.images import encode_depth, encode_fraction, read_fraction
from deux.io.json_files import checked_record, decode_json
from deux.metrics.depth_errors import METRICS
from deux.metrics.tables import csv_text
from deux.tasks.depth_completion import CompletedDepth
from deux.tasks.predict_settings import DepthFormat
from deux.tasks.run_folder import JOURNAL

ERRORS_FILE = "errors.csv"
"""The errors of each frame with ground truth, and those of interpolation."""


@dataclass(frozen=True)
class FrameRecord:
    """The journal's record of a completed frame.

    Args:
        sequence: sequence of the frame.
        name: name of the frame.
        depth: 1st, 50th and 99th percentile of the predicted depth, metres.
        pixels: number of pixels that were compared with ground truth.
        errors: errors of the prediction by the names in `METRICS`; empty without ground truth.
        interpolated: errors of interpolation on the same pixels; empty without ground truth or sparse points.
    """

    sequence: str
    name: str
    depth: tuple[float, float, float]
    pixels: int = 0
    errors: dict[str, float] = field(default_factory=dict)
    interpolated: dict[str, float] = field(default_factory=dict)


class PredictionFolder:
    """Reads and writes predictions. A frame is complete if it is in the journal and its depth file exists.

        depth/<sequence>/<frame>.png        16 bits, metres x 256; or .npy, float32 metres
        confidence/<sequence>/<frame>.png   16 bits, confidence x 65535, 0 = no value; or .npy, float32
        frames.jsonl                        the journal: a JSON line for each frame, a `FrameRecord`
        errors.csv

    Args:
        folder: the run folder.
        depth_format: file format of depth and confidence.

    Raises:
        DeuxError: a file cannot be written.
    """

    def __init__(self, folder: Path, depth_format: DepthFormat) -> None:
        self.folder = folder
        self._format = depth_format
        self.records = {FrameReference(record.sequence, record.name): record for record in self._journal()}
        lines = "".join(_line(record) for record in self.records.values())
        write_atomically(folder / JOURNAL, lines.encode())  # drops an incomplete last line

    def file(self, kind: str, frame: FrameReference) -> Path:
        """Path of a frame's "depth" or "confidence".

        Raises:
            DeuxError: the frame's names, which may come from external files, lead out of the folder.
        """
        check_frame_path(frame.sequence, frame.name, self.folder)
        return self.folder / kind / frame.sequence / f"{frame.name}.{self._format}"

    def write(self, batch: Sequence[tuple[FrameReference, CompletedDepth, FrameRecord]]) -> None:
        """Write the files of a batch of frames, then its lines in the journal, in one write.

        A batch is in the journal as a whole or not at all, so that a resumed command forms the same batches: the last
        bits of a frame's depth depend on the other frames of its batch.
        """
        for frame, completed, _ in batch:
            if completed.confidence is not None:
                self._write(self.file("confidence", frame), completed.confidence, encode_fraction)
            self._write(self.file("depth", frame), completed.depth, encode_depth)
        try:
            with (self.folder / JOURNAL).open("ab", buffering=0) as journal:  # a single system call
                journal.write("".join(_line(record) for _, _, record in batch).encode())
        except OSError as error:
            raise DeuxError(write_failure(self.folder / JOURNAL, error)) from error
        self.records |= {frame: record for frame, _, record in batch}

    def read(self, frame: FrameReference) -> CompletedDepth:
        """Read a frame's depth and confidence."""
        confidence = self.read_confidence(frame) if self.file("confidence", frame).exists() else None
        return CompletedDepth(self.read_depth(frame), confidence)

    def read_depth(self, frame: FrameReference) -> np.ndarray:
        """Read a frame's depth, H x W float32 metres."""
        return read_any_depth(self.file("depth", frame))

    def read_confidence(self, frame: FrameReference) -> np.ndarray:
        """Read a frame's confidence, H x W float32 in [0, 1]."""
        path = self.file("confidence", frame)
        return read_any_depth(path) if self._format == "npy" else read_fraction(path)

    def write_errors(self, frames: Sequence[FrameReference]) -> Path | None:
        """Write `errors.csv` in the order of the frames; returns None, without a file, if none has ground truth."""
        records = [record for frame in frames if (record := self.records[frame]).errors]
        if not records:
            return None
        header = ["sequence", "frame", "pixels", *METRICS, *(f"interpolated_{name}" for name in METRICS)]
        rows = []
        for record in records:
            values = [*(record.errors[name] for name in METRICS), *(record.interpolated.get(name) for name in METRICS)]
            rows.append([record.sequence, record.name, record.pixels, *values])
        path = self.folder / ERRORS_FILE
        write_atomically(path, csv_text(header, rows).encode())
        return path

    def _journal(self) -> Iterable[FrameRecord]:
        try:
            lines = (self.folder / JOURNAL).read_bytes().splitlines()
        except FileNotFoundError:
            return
        for line in lines:
            try:
                record = checked_record(decode_json(line, self.folder / JOURNAL), FrameRecord, JOURNAL)
            except DeuxError:  # incomplete, as the command was killed while writing it
                continue
            complete = all(
                not errors or METRICS.keys() <= errors.keys() for errors in (record.errors, record.interpolated)
            )
            if not (complete and is_frame_path(record.sequence, record.name)):
                continue
            if self.file("depth", FrameReference(record.sequence, record.name)).exists():
                yield record

    def _write(self, path: Path, values: np.ndarray, encode: Callable[[np.ndarray], bytes]) -> None:
        make_folder(path.parent)
        write_atomically(path, encode(values) if self._format == "png" else encode_array(values))


def encode_array(values: np.ndarray) -> bytes:
    """Encode an array as the content of a .npy file."""
    content = io.BytesIO()
    np.save(content, values, allow_pickle=False)
    return content.getvalue()


def _line(record: FrameRecord) -> str:
    return json.dumps(asdict(record)) + "\n"
