"""Conformance suite for readers: tests of the contract of `deux.contracts.Reader`.

A plugin's test file subclasses it and defines how recordings are written in its layout; pytest runs the whole suite:

    class TestMyReader(ReaderSuite):
        def write_dataset(self, folder: Path, recordings: Recordings) -> None:
            ...  # all frames of all sequences, as the split "train"

        def make_reader(self, folder: Path) -> Reader:
            return MyReader(folder)

The recordings are walks through rooms of `deux.testing.box_world` with different cameras. The tests compare the output
of the reader with the recorded arrays.
"""

import pickle
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from deux.contracts import Action, FrameReference, MissingSplit, Reader, Triplet
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.layout import natural_order
from deux.testing.box_world import Box, BoxWorld


@dataclass(frozen=True)
class RecordedFrame:
    """One frame of a recording.

    Args:
        image: H x W x 3 uint8 RGB.
        sparse_depth: H x W float32 metres in multiples of 1/256 m, for a tenth of the pixels; 0 = none.
        ground_truth: H x W float32 metres in multiples of 1/256 m; 0 = none.
        intrinsics: 3 x 3 float64.
        pose: 4 x 4 float64, camera-to-world.
    """

    image: np.ndarray
    sparse_depth: np.ndarray
    ground_truth: np.ndarray
    intrinsics: np.ndarray
    pose: np.ndarray


Recordings = Mapping[str, Sequence[RecordedFrame]]
"""Frames of each sequence in temporal order, by name of the sequence."""

OFFSETS = (-1, -2)


def record(frames: int = 5) -> Recordings:
    """Create two sequences of `frames` frames each, with different image sizes."""
    rng = np.random.default_rng(0)
    recordings = {}
    for name, camera in (("corridor", Camera(24, 16)), ("office", Camera(20, 18, hfov=70.0))):
        world = BoxWorld(4.0, 5.0, (Box(0.5, 0.5, 1.0, 1.2, 0.8),), camera)
        world.reset(2.0, 4.0, 0.2)
        recordings[name] = [_frame(world, rng) for _ in range(frames)]
    return recordings


def _frame(world: BoxWorld, rng: np.random.Generator) -> RecordedFrame:
    world.step(Action.FORWARD)
    world.step(Action.LEFT)
    frame = world.observe()
    depth = (np.rint(frame.depth * 256.0) / 256.0).astype(np.float32)
    sparse = np.where(rng.random(depth.shape) < 0.1, depth, np.float32(0.0))
    return RecordedFrame(frame.rgb, sparse, depth, world.camera.intrinsics, frame.pose)


class ReaderSuite:
    """Base class of the tests of a reader. Subclasses define `write_dataset` and `make_reader`.

    Set `has_poses` or `has_ground_truth` to False for a layout without them, `takes_offsets` to False for a layout that
    lists the source frames of each target, and the tolerances for a layout that does not store exact values.
    """

    has_poses: ClassVar[bool] = True
    has_ground_truth: ClassVar[bool] = True
    takes_offsets: ClassVar[bool] = True
    image_tolerance: ClassVar[int] = 0
    depth_tolerance: ClassVar[float] = 1e-6

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        """Write all frames to an empty folder as the split "train"; source frames, if listed, are at `OFFSETS`."""
        raise NotImplementedError

    def make_reader(self, folder: Path) -> Reader:
        """Create a reader of the folder."""
        raise NotImplementedError

    @pytest.fixture
    def recordings(self) -> Recordings:
        """Recordings to write."""
        return record()

    @pytest.fixture
    def folder(self, tmp_path: Path, recordings: Recordings) -> Path:
        """Folder with the written recordings."""
        folder = tmp_path / "dataset"
        folder.mkdir()
        self.write_dataset(folder, recordings)
        return folder

    def test_keeps_its_folder(self, folder: Path) -> None:
        """The attribute `folder` is the folder of the dataset."""
        assert self.make_reader(folder).folder == folder

    def test_lists_targets_in_order_with_their_sources(self, folder: Path, recordings: Recordings) -> None:
        """Every frame that has both source frames is a target with these sources, and names sort in temporal order.

        Other frames may be targets without sources, so that a test split can contain all frames.
        """
        reader = self.make_reader(folder)
        for offsets in (OFFSETS, (-1, 1)) if self.takes_offsets else (OFFSETS,):
            found = reader.triplets("train", offsets)
            assert found == reader.triplets("train", offsets), "the order changes from call to call"
            assert len({target for target, _ in found}) == len(found), "a frame is a target twice"
            found = [triplet for triplet in found if triplet.sources]
            first, last = max(0, -min(offsets)), max(0, *offsets)
            expected = sum(len(frames) - first - last for frames in recordings.values())
            assert len(found) == expected, f"{len(found)} targets where {expected} have sources at {offsets}"
            times = self._times(reader)
            for target, sources in found:
                steps = [times[source] - times[target] for source in sources]
                assert steps == list(offsets), f"the sources of {target} lie at {steps}, not at {list(offsets)}"
                assert {source.sequence for source in sources} == {target.sequence}, "a source of another sequence"

    def test_lists_every_frame_once(self, folder: Path) -> None:
        """`frames` contains all targets once, with the frames of each sequence in temporal order."""
        reader = self.make_reader(folder)
        found = reader.frames()
        assert len(set(found)) == len(found), "a frame is listed twice"
        assert {target for target, _ in reader.triplets("train", OFFSETS)} <= set(found), "a target is not listed"
        for sequence in {frame.sequence for frame in found}:
            names = [frame.name for frame in found if frame.sequence == sequence]
            assert names == sorted(names, key=natural_order), f"the frames of {sequence} are not in the order of time"
        assert reader.sparse_depth(found[0]).shape == reader.image(found[0]).shape[:2]

    def test_place_names_where_each_frame_was_taken(self, folder: Path) -> None:
        """`place` returns a name, which is the same for all frames of a sequence and differs between the sequences."""
        reader = self.make_reader(folder)
        places: dict[str, str] = {}
        for frame in self._frames(reader):
            place = reader.place(frame)
            assert isinstance(place, str), f"the place of {frame} is {place!r}"
            assert place, f"the place of {frame} has no name"
            assert places.setdefault(frame.sequence, place) == place, f"the frames of {frame.sequence} lie apart"
        assert len(set(places.values())) == len(places), f"different rooms are one place: {places}"

    def test_reads_what_was_recorded(self, folder: Path, recordings: Recordings) -> None:
        """Images, intrinsics, depth and poses of all frames have the recorded values, and the types of the contract."""
        reader = self.make_reader(folder)
        frames = self._frames(reader)
        assert len({frame.sequence for frame in frames}) == len(recordings), "the sequences are not kept apart"
        for frame, recorded in zip(frames, _all(recordings), strict=True):
            self._check(reader, frame, recorded)

    def test_a_split_that_is_not_there_is_an_error(self, folder: Path) -> None:
        """`triplets` raises MissingSplit for a missing split."""
        with pytest.raises(MissingSplit):
            self.make_reader(folder).triplets("validation", OFFSETS)

    def test_a_folder_without_frames_is_an_error(self, tmp_path: Path) -> None:
        """An empty folder raises DeuxError, in the constructor or in `triplets`."""
        (tmp_path / "empty").mkdir()
        with pytest.raises(DeuxError):
            self.make_reader(tmp_path / "empty").triplets("train", OFFSETS)

    def test_a_damaged_file_is_an_error_or_does_not_matter(self, folder: Path, recordings: Recordings) -> None:
        """If any file is truncated to half its size, the reader returns the recorded values or raises DeuxError."""
        recorded = dict(zip(self._frames(self.make_reader(folder)), _all(recordings), strict=True))
        for file in sorted(path for path in folder.rglob("*") if path.is_file()):
            content = file.read_bytes()
            file.write_bytes(content[: len(content) // 2])
            # Other errors fail the test.
            with suppress(DeuxError):
                reader = self.make_reader(folder)
                for frame in self._frames(reader):
                    reader.image(frame)  # the truncated file may be a list of names
                    self._check(reader, frame, recorded[frame])
            file.write_bytes(content)

    def test_reads_no_pixel_before_it_must(self, folder: Path) -> None:
        """The constructor and `triplets` open no image."""
        expected = self.make_reader(folder).triplets("train", OFFSETS)
        for file in folder.rglob("*"):
            if file.suffix in (".png", ".jpg", ".jpeg"):
                file.write_bytes(b"")
        assert self.make_reader(folder).triplets("train", OFFSETS) == expected

    def test_can_be_sent_and_compared(self, folder: Path) -> None:
        """Readers can be pickled for worker processes; those with equal arguments are equal and have equal hashes."""
        reader = self.make_reader(folder)
        assert pickle.loads(pickle.dumps(reader)) == reader, "a reader that was sent differs"
        assert self.make_reader(folder) == reader, "two readers of one folder differ"
        assert hash(self.make_reader(folder)) == hash(reader), "equal readers have different hashes"

    def test_gives_arrays_away(self, folder: Path) -> None:
        """Modifying a returned array does not change arrays that are read later."""
        reader = self.make_reader(folder)
        frame = self._frames(reader)[0]
        for read in (reader.image, reader.intrinsics, reader.sparse_depth, reader.ground_truth, reader.pose):
            array = read(frame)
            if array is not None and array.flags.writeable:
                before = array.copy()
                array[...] = 0
                np.testing.assert_array_equal(read(frame), before)

    def _frames(self, reader: Reader) -> list[FrameReference]:
        """All targets and source frames of the triplets, by sequence and in temporal order."""
        found = set(_frames_of(reader.triplets("train", OFFSETS)))
        return sorted(found, key=lambda frame: (frame.sequence, natural_order(frame.name)))

    def _times(self, reader: Reader) -> dict[FrameReference, int]:
        frames = self._frames(reader)
        first = {frame.sequence: number for number, frame in reversed(list(enumerate(frames)))}
        return {frame: number - first[frame.sequence] for number, frame in enumerate(frames)}

    def _check(self, reader: Reader, frame: FrameReference, recorded: RecordedFrame) -> None:
        image = reader.image(frame)
        assert (image.dtype, image.shape) == (np.uint8, recorded.image.shape), (
            f"the image is {image.dtype} {image.shape}"
        )
        np.testing.assert_allclose(image.astype(int), recorded.image, atol=self.image_tolerance, rtol=0.0)
        intrinsics = reader.intrinsics(frame)
        assert intrinsics.dtype == np.float64, f"the intrinsics are {intrinsics.dtype}"
        np.testing.assert_allclose(intrinsics, recorded.intrinsics, rtol=1e-6)
        self._check_depth(reader.sparse_depth(frame), recorded.sparse_depth)
        truth, pose = reader.ground_truth(frame), reader.pose(frame)
        assert (truth is not None) == self.has_ground_truth, "ground truth, or none, against `has_ground_truth`"
        assert (pose is not None) == self.has_poses, "a pose, or none, against `has_poses`"
        if truth is not None:
            self._check_depth(truth, recorded.ground_truth)
        if pose is not None:
            assert pose.dtype == np.float64, f"the pose is {pose.dtype}"
            np.testing.assert_allclose(pose, recorded.pose, atol=1e-6)

    def _check_depth(self, depth: np.ndarray, recorded: np.ndarray) -> None:
        assert (depth.dtype, depth.shape) == (np.float32, recorded.shape), f"depth is {depth.dtype} {depth.shape}"
        np.testing.assert_array_equal(depth > 0, recorded > 0)
        np.testing.assert_allclose(depth, recorded, atol=self.depth_tolerance, rtol=0.0)


def _all(recordings: Recordings) -> Iterator[RecordedFrame]:
    """Yield all frames, by sequence in the order of the names."""
    for name in sorted(recordings):
        yield from recordings[name]


def _frames_of(triplets: Sequence[Triplet]) -> Iterator[FrameReference]:
    for target, sources in triplets:
        yield from (target, *sources)
