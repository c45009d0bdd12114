"""The suite must fail for readers that break the contract, each in the test that is meant for it."""

import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from deux.contracts import FrameReference, MissingSplit, Reader, Triplet
from deux.errors import DeuxError
from deux.testing.readers import ReaderSuite, Recordings, record


@dataclass(frozen=True)
class ArrayReader(Reader):
    """A folder of .npz files, one a frame, with one thing wrong."""

    folder: Path
    fault: str = "none"

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        listed = self.folder / ("train.json" if self.fault == "any split" else f"{split}.json")
        if not listed.exists() and self.fault != "no frames":
            raise MissingSplit(f"{listed} is missing.")
        try:
            counts = json.loads(listed.read_text()) if listed.exists() else {}
        except ValueError as error:
            raise DeuxError(f"{listed} is damaged.") from error
        return [
            Triplet(
                FrameReference(sequence, f"{number}"),
                tuple(FrameReference(sequence, f"{number + step}") for step in self._steps(offsets)),
            )
            for sequence, count in counts.items()
            for number in range(max(0, -min(offsets)), count - max(0, *offsets))
        ]

    def _steps(self, offsets: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(reversed(offsets)) if self.fault == "other sources" else offsets

    def _read(self, frame: FrameReference, kind: str) -> np.ndarray:
        try:
            return np.load(io.BytesIO((self.folder / frame.sequence / f"{frame.name}.npz").read_bytes()))[kind]
        except Exception as error:
            if self.fault == "stack traces":
                raise
            raise DeuxError(f"frame {frame} is damaged.") from error

    def place(self, frame: FrameReference) -> str:
        return "here" if self.fault == "one place" else super().place(frame)

    def image(self, frame: FrameReference) -> np.ndarray:
        image = self._read(frame, "image")
        return image[..., ::-1] if self.fault == "BGR" else image

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        matrix = self._read(frame, "intrinsics")
        return matrix.astype(np.float32) if self.fault == "float32 intrinsics" else matrix

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        depth = self._read(frame, "sparse_depth")
        return depth * np.float32(1000.0) if self.fault == "millimetres" else depth

    def ground_truth(self, frame: FrameReference) -> np.ndarray:
        return self._read(frame, "ground_truth")

    def pose(self, frame: FrameReference) -> np.ndarray:
        pose = self._read(frame, "pose")
        return np.linalg.inv(pose) if self.fault == "world-to-camera" else pose


class IncomparableReader(ArrayReader):
    __eq__ = object.__eq__
    __hash__ = object.__hash__


class ArraySuite(ReaderSuite):
    fault = "none"

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for sequence, frames in recordings.items():
            (folder / sequence).mkdir()
            for number, frame in enumerate(frames):
                np.savez(folder / sequence / f"{number}.npz", **vars(frame))
        (folder / "train.json").write_text(json.dumps({name: len(frames) for name, frames in recordings.items()}))

    def make_reader(self, folder: Path) -> Reader:
        return IncomparableReader(folder) if self.fault == "incomparable" else ArrayReader(folder, self.fault)


class TestSoundReader(ArraySuite):
    """A reader without a fault passes."""


@pytest.mark.parametrize(
    ("fault", "test"),
    [
        ("any split", "test_a_split_that_is_not_there_is_an_error"),
        ("other sources", "test_lists_targets_in_order_with_their_sources"),
        ("BGR", "test_reads_what_was_recorded"),
        ("float32 intrinsics", "test_reads_what_was_recorded"),
        ("millimetres", "test_reads_what_was_recorded"),
        ("world-to-camera", "test_reads_what_was_recorded"),
        ("stack traces", "test_a_damaged_file_is_an_error_or_does_not_matter"),
        ("one place", "test_place_names_where_each_frame_was_taken"),
        ("incomparable", "test_can_be_sent_and_compared"),
    ],
)
def test_a_broken_reader_fails(tmp_path: Path, fault: str, test: str) -> None:
    suite = ArraySuite()
    suite.fault = fault
    suite.write_dataset(tmp_path, record())
    arguments = (tmp_path, record()) if "recordings" in getattr(ReaderSuite, test).__annotations__ else (tmp_path,)
    with pytest.raises((AssertionError, zipfile.BadZipFile, pytest.fail.Exception)):
        getattr(suite, test)(*arguments)


def test_a_reader_that_gives_no_frames_for_an_empty_folder_fails(tmp_path: Path) -> None:
    suite = ArraySuite()
    suite.fault = "no frames"
    with pytest.raises(pytest.fail.Exception, match="DID NOT RAISE"):
        suite.test_a_folder_without_frames_is_an_error(tmp_path)
