"""Frames that are read ahead: the same as from the reader, in order, with the sources that were chosen."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deux.data.chosen_sources import sources_by_parallax
from deux.data.frame_stream import FrameStream
from deux.errors import DeuxError
from deux.io.images import write_depth
from deux.testing.readers import record
from deux_plugins.readers.rgbd_folder import RgbdFolder


@pytest.fixture
def reader(tmp_path: Path) -> RgbdFolder:
    """A walk of 14 frames with points, depth and poses."""
    frames = record(14)["corridor"]
    for kind in ("images", "depth", "sparse"):
        (tmp_path / kind).mkdir()
    for number, frame in enumerate(frames):
        Image.fromarray(frame.image).save(tmp_path / "images" / f"{number}.png")
        write_depth(tmp_path / "depth" / f"{number}.png", frame.ground_truth)
        write_depth(tmp_path / "sparse" / f"{number}.png", frame.sparse_depth)
    np.savetxt(tmp_path / "K.txt", frames[0].intrinsics)
    np.savetxt(tmp_path / "poses.txt", [frame.pose.ravel() for frame in frames])
    return RgbdFolder(tmp_path, scale=256.0)


def test_frames_come_whole_and_in_order(reader: RgbdFolder) -> None:
    frames = reader.frames()
    assert len(frames) == 14  # those between two splits as well
    found = list(FrameStream(reader)(frames))
    assert [name for name, _ in found] == frames
    for name, frame in found:
        for kind in ("image", "sparse_depth", "intrinsics", "ground_truth", "pose"):
            np.testing.assert_array_equal(getattr(frame, kind), getattr(reader, kind)(name))
        assert frame.sources == ()


def test_sources_are_neighbours_with_parallax(reader: RgbdFolder) -> None:
    frames = reader.frames()
    chosen = sources_by_parallax(reader, frames)
    assert list(chosen) == frames
    number = {name: place for place, name in enumerate(frames)}
    for name, frame in FrameStream(reader, chosen)(frames):
        assert 0 < max(abs(number[source] - number[name]) for source in chosen[name]) <= 5
        assert len(frame.sources) == 2
        for source, given in zip(chosen[name], frame.sources, strict=True):
            np.testing.assert_array_equal(given.image, reader.image(source))
            point = np.array([0.3, -0.2, 2.0, 1.0])
            np.testing.assert_allclose(
                reader.pose(source) @ given.source_from_target @ point, reader.pose(name) @ point, atol=1e-9
            )


def test_depths_are_left_out_where_nobody_needs_them(reader: RgbdFolder) -> None:
    frame = FrameStream(reader, depths=False).read(reader.frames()[0])
    assert not frame.sparse_depth.any()
    assert frame.ground_truth is None


def test_a_size_that_differs_is_an_error(reader: RgbdFolder, tmp_path: Path) -> None:
    write_depth(tmp_path / "sparse" / "3.png", np.ones((5, 6), np.float32))
    stream = FrameStream(reader)(reader.frames())
    with pytest.raises(DeuxError, match=r"frame 3 of .* has an image of 24 x 16 pixels and sparse depth of 6 x 5"):
        list(stream)
