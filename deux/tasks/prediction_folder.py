"""The results of many frames: a depth file for each, and a journal that tells which of them are done."""

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
"""The errors of each frame that has ground truth, beside those of interpolation."""


@dataclass(frozen=True)
class FrameRecord:
    """What is noted of a frame that is done.

    Args:
        sequence: its sequence.
        name: its name.
        depth: 1st, 50th and 99th percentile of the predicted depth, metres.
        pixels: number of pixels that were compared with ground truth.
        errors: of the prediction, by the names in `METRICS`; none without ground truth.
        interpolated: of the interpolated points on the same pixels; none without ground truth or without points.
    """

    sequence: str
    name: str
    depth: tuple[float, float, float]
    pixels: int = 0
    errors: dict[str, float] = field(default_factory=dict)
    interpolated: dict[str, float] = field(default_factory=dict)


class PredictionFolder:
    """Reads and writes the results. A frame counts once it stands in the journal and its depth file is there.

        depth/<sequence>/<frame>.png        16 bits, metres x 256; or .npy, float32 metres
        confidence/<sequence>/<frame>.png   16 bits, confidence x 65535, 0 = none; or .npy, float32
        frames.jsonl                        the journal: a line of JSON for each frame, a `FrameRecord`
        errors.csv

    Args:
        folder: the run's folder.
        depth_format: of depth and confidence.

    Raises:
        DeuxError: a file cannot be written.
    """

    def __init__(self, folder: Path, depth_format: DepthFormat) -> None:
        self.folder = folder
        self._format = depth_format
        self.records = {FrameReference(record.sequence, record.name): record for record in self._journal()}
        lines = "".join(_line(record) for record in self.records.values())
        write_atomically(folder / JOURNAL, lines.encode())  # without a last line that was cut short

    def file(self, kind: str, frame: FrameReference) -> Path:
        """Where a frame's "depth" or "confidence" lies.

        Raises:
            DeuxError: the frame's names, which may come from a file from outside, would lead out of the folder.
        """
        check_frame_path(frame.sequence, frame.name, self.folder)
        return self.folder / kind / frame.sequence / f"{frame.name}.{self._format}"

    def write(self, batch: Sequence[tuple[FrameReference, CompletedDepth, FrameRecord]]) -> None:
        """Write the files of frames that were predicted together, then their lines in the journal, all at once.

        A batch is in the journal as a whole or not at all, so that a command which goes on after a kill forms the same
        batches: a frame's depth depends, in its last bits, on the frames beside it.
        """
        for frame, completed, _ in batch:
            if completed.confidence is not None:
                self._write(self.file("confidence", frame), completed.confidence, encode_fraction)
            self._write(self.file("depth", frame), completed.depth, encode_depth)
        try:
            with (self.folder / JOURNAL).open("ab", buffering=0) as journal:  # one call of the system
                journal.write("".join(_line(record) for _, _, record in batch).encode())
        except OSError as error:
            raise DeuxError(write_failure(self.folder / JOURNAL, error)) from error
        self.records |= {frame: record for frame, _, record in batch}

    def read(self, frame: FrameReference) -> CompletedDepth:
        """What was written of a frame, as the files hold it."""
        confidence = self.read_confidence(frame) if self.file("confidence", frame).exists() else None
        return CompletedDepth(self.read_depth(frame), confidence)

    def read_depth(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 metres."""
        return read_any_depth(self.file("depth", frame))

    def read_confidence(self, frame: FrameReference) -> np.ndarray:
        """H x W float32 in [0, 1]."""
        path = self.file("confidence", frame)
        return read_any_depth(path) if self._format == "npy" else read_fraction(path)

    def write_errors(self, frames: Sequence[FrameReference]) -> Path | None:
        """Write `errors.csv` in the order of the frames; None, and no file, if none has ground truth."""
        rows = [record for frame in frames if (record := self.records[frame]).errors]
        if not rows:
            return None
        header = ["sequence", "frame", "pixels", *METRICS, *(f"interpolated_{name}" for name in METRICS)]
        lines = []
        for row in rows:
            values = [*(row.errors[name] for name in METRICS), *(row.interpolated.get(name) for name in METRICS)]
            lines.append([row.sequence, row.name, row.pixels, *values])
        path = self.folder / ERRORS_FILE
        write_atomically(path, csv_text(header, lines).encode())
        return path

    def _journal(self) -> Iterable[FrameRecord]:
        try:
            lines = (self.folder / JOURNAL).read_bytes().splitlines()
        except FileNotFoundError:
            return
        for line in lines:
            try:
                record = checked_record(decode_json(line, self.folder / JOURNAL), FrameRecord, JOURNAL)
            except DeuxError:  # the line that was being written when the command was killed
                continue
            whole = all(
                not errors or METRICS.keys() <= errors.keys() for errors in (record.errors, record.interpolated)
            )
            if not (whole and is_frame_path(record.sequence, record.name)):
                continue
            if self.file("depth", FrameReference(record.sequence, record.name)).exists():
                yield record

    def _write(self, path: Path, values: np.ndarray, encode: Callable[[np.ndarray], bytes]) -> None:
        make_folder(path.parent)
        write_atomically(path, encode(values) if self._format == "png" else encode_array(values))


def encode_array(values: np.ndarray) -> bytes:
    """The .npy file of an array."""
    content = io.BytesIO()
    np.save(content, values, allow_pickle=False)
    return content.getvalue()


def _line(record: FrameRecord) -> str:
    return json.dumps(asdict(record)) + "\n"
