"""The cache in memory: what it keeps, its bound, and that processes share it."""

import multiprocessing
from collections import Counter
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch

from deux.contracts import FrameReference, Reader, Triplet
from deux.data.device_cache import DeviceCache
from deux.data.frame_cache import FrameCache, FrameKey, Kind, MemoryCache, compact, metres, stored_bytes
from deux.errors import DeuxError

SHAPE = (6, 10)
IMAGE = 3 * 6 * 10
CPU = torch.device("cpu")


class CountingReader(Reader):
    """Frames of random pixels, named by their seeds, that count how often they are read in this process."""

    reads: ClassVar[Counter[tuple[str, str]]] = Counter()

    def __init__(self, folder: Path = Path("."), scale: float = 256.0) -> None:
        self.folder, self.scale = folder, scale

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        return [Triplet(frame, ()) for frame in FRAMES]

    def image(self, frame: FrameReference) -> np.ndarray:
        self.reads["image", frame.name] += 1
        return np.random.default_rng(int(frame.name)).integers(256, size=(*SHAPE, 3), dtype=np.uint8)

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        return np.eye(3)

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        self.reads["sparse_depth", frame.name] += 1
        code = np.random.default_rng(int(frame.name)).integers(2**16, size=SHAPE)
        return code.astype(np.float32) / np.float32(self.scale)


FRAMES = [FrameReference("room", str(number)) for number in range(4)]


@pytest.fixture(autouse=True)
def _nothing_read() -> None:
    CountingReader.reads.clear()


def keys(reader: Reader, kind: str = "image") -> list[FrameKey]:
    return [FrameKey(reader, kind, frame) for frame in FRAMES]  # type: ignore[arg-type]


def test_stored_depth_gives_back_every_value_of_a_file() -> None:
    code = np.arange(2**16 - 1, dtype=np.uint16).reshape(255, 257)  # the last value is no depth
    depth = code.astype(np.float32) / np.float32(256.0)
    assert compact(depth).dtype == np.uint16
    np.testing.assert_array_equal(metres(compact(depth)), depth)


@pytest.mark.parametrize("value", [0.001, 300.0, np.nan, -1.0])
def test_depth_that_16_bits_do_not_hold_is_kept_as_it_is(value: float) -> None:
    depth = np.array([[1.0, value]], np.float32)
    assert compact(depth).dtype == np.float32
    np.testing.assert_array_equal(metres(compact(depth)), depth)


@pytest.mark.parametrize("scale", [256.0, 1000.0])
@pytest.mark.parametrize("cache", [MemoryCache(10**6), DeviceCache(CPU, 10**6)], ids=["memory", "device"])
def test_a_cache_reads_everything_once(cache: FrameCache, scale: float) -> None:
    reader = CountingReader(scale=scale)
    wanted = [*keys(reader), *keys(reader, "sparse_depth")]
    cache.reserve(wanted, stored_bytes(wanted, {}))
    CountingReader.reads.clear()
    for _ in range(3):
        for key in wanted:
            found = np.asarray(cache.read(key))
            if key.kind == "image":
                np.testing.assert_array_equal(found, reader.image(key.frame).transpose(2, 0, 1))
            else:
                np.testing.assert_array_equal(metres(found), reader.sparse_depth(key.frame))
    assert set(CountingReader.reads.values()) == {4}  # once by the cache, three times by this test


@pytest.mark.parametrize("kind", [MemoryCache, lambda size: DeviceCache(CPU, size)], ids=["memory", "device"])
def test_what_does_not_fit_is_read_each_time(kind: type[MemoryCache]) -> None:
    reader, cache = CountingReader(), kind(2 * IMAGE + 100)
    cache.reserve(keys(reader), 10**6)
    for _ in range(3):
        for key in keys(reader):
            cache.read(key)
    assert list(CountingReader.reads.values()) == [1, 1, 3, 3]


@pytest.mark.parametrize("kind", [MemoryCache, lambda size: DeviceCache(CPU, size)], ids=["memory", "device"])
def test_new_frames_are_added_and_those_out_of_use_make_room(kind: type[MemoryCache]) -> None:
    first, second, third = (CountingReader() for _ in range(3))
    cache = kind(12 * IMAGE)
    for readers in ([first], [first, second], [third]):
        wanted = [key for reader in readers for key in keys(reader)]
        cache.reserve(wanted, stored_bytes((key for key in wanted if not cache.holds(key)), {}))
        CountingReader.reads.clear()
        for _ in range(2):
            for key in wanted:
                cache.read(key)
        # Of the second time, the frames of the first reader are there.
        assert set(CountingReader.reads.values()) == {1}
        assert not any(cache.holds(key) for reader in (first, second) if reader not in readers for key in keys(reader))


def test_sizes_are_judged_by_one_frame_of_each_reader_and_kind() -> None:
    reader, millimetres = CountingReader(), CountingReader(scale=1000.0)
    known: dict[tuple[Reader, Kind], int] = {}
    depth = [*keys(reader, "sparse_depth"), *keys(millimetres, "sparse_depth")]
    assert stored_bytes([*keys(reader), *depth], known) == 4 * (IMAGE + 2 * 60 + 4 * 60)
    assert CountingReader.reads.total() == 3
    assert stored_bytes(keys(reader), known) == 4 * IMAGE
    assert CountingReader.reads.total() == 3


def _read_all(cache: MemoryCache, wanted: list[FrameKey], answers: "multiprocessing.Queue[int]") -> None:
    for key in wanted:
        cache.read(key)
    answers.put(CountingReader.reads.total())


def test_what_one_process_has_decoded_is_there_for_the_others() -> None:
    wanted, cache = keys(CountingReader()), MemoryCache(10**6)
    cache.reserve(wanted, 10**4)
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    counts = []
    for _ in range(2):
        process = context.Process(target=_read_all, args=(cache, wanted, answers))
        process.start()
        counts.append(answers.get(timeout=60))
        process.join()
    assert counts == [4, 0]
    np.testing.assert_array_equal(cache.read(wanted[2]), CountingReader().image(FRAMES[2]).transpose(2, 0, 1))


def test_what_is_kept_cannot_be_written_to() -> None:
    wanted, cache = keys(CountingReader()), MemoryCache(10**6)
    cache.reserve(wanted, 10**4)
    cache.read(wanted[0])
    with pytest.raises(ValueError, match="read-only"):
        cache.read(wanted[0])[0, 0, 0] = 1  # type: ignore[index]


@pytest.mark.parametrize("kind", ["image", "sparse_depth", "ground_truth"])
def test_what_a_reader_gives_is_checked_before_it_is_kept(kind: Kind) -> None:
    class OddReader(CountingReader):
        pass

    setattr(OddReader, kind, lambda self, frame: np.ones(SHAPE))
    cache = MemoryCache(10**6)
    cache.reserve([FrameKey(OddReader(), kind, FRAMES[0])], 1000)
    for _ in range(2):
        with pytest.raises(
            DeuxError, match=rf"^the `{kind}` of the reader OddReader gives ndarray of 6 x 10, float64 "
        ):
            cache.read(FrameKey(OddReader(), kind, FRAMES[0]))
