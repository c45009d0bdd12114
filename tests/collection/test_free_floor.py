"""The free floor that a dataset keeps, against the simulator's own."""

import numpy as np
import pytest

from deux.collection.free_floor import read_free_floor, write_free_floor
from deux.errors import DeuxError
from deux.io.layout import SequencePaths
from deux.testing.box_world import Box, BoxWorld


def test_the_free_floor_is_read_as_it_was_written(tmp_path):
    space = BoxWorld(5.0, 4.0, (Box(1.0, 2.6, 2.0, 3.0),)).free_space().moved(1.25, 0.0, -7.5)
    write_free_floor(tmp_path, space)
    frame, free = read_free_floor(SequencePaths(tmp_path))
    assert frame == space.frame
    np.testing.assert_array_equal(free, space.free)
    assert (tmp_path / "free_floor.npz").stat().st_size < 1500


def test_recorded_frames_have_none(tmp_path):
    assert read_free_floor(SequencePaths(tmp_path)) is None


def test_a_damaged_file_is_reported(tmp_path):
    (tmp_path / "free_floor.npz").write_bytes(b"{}")
    with pytest.raises(DeuxError, match=r"free_floor\.npz is damaged"):
        read_free_floor(SequencePaths(tmp_path))
