"""Sparse points: as many as asked for, at corners, spread over the image, from the image alone."""

from pathlib import Path

import numpy as np
import pytest
from toy_world import ToySimulator

from deux.collection import sparse
from deux.collection.sparse import SparseSettings, point_count, sample_sequences, sample_sparse
from deux.io.images import read_depth, write_depth, write_image
from deux.io.layout import SequencePaths

PAPER = SparseSettings()


def noise(size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (size, size, 3), dtype=np.uint8)


def test_the_paper_takes_1500_points_of_160000() -> None:
    assert point_count((400, 400), PAPER) == 1500


@pytest.mark.parametrize("density", [0.001, PAPER.density, 0.05, 0.5])
@pytest.mark.parametrize("kind", ["noise", "flat", "half flat", "room"])
def test_the_count_is_reached_in_any_image(kind: str, density: float) -> None:
    image = {
        "noise": noise(96),
        "flat": np.full((96, 96, 3), 77, np.uint8),
        "half flat": np.hstack([noise(96)[:, :48], np.zeros((96, 48, 3), np.uint8)]),
        "room": ToySimulator().observe().rgb,
    }[kind]
    settings = SparseSettings(density)
    sparse = sample_sparse(image, np.full(image.shape[:2], 2.0, np.float32), settings)
    assert (sparse > 0).sum() == point_count(image.shape[:2], settings)


def test_points_carry_the_depth_under_them_and_lie_only_where_there_is_depth() -> None:
    depth = np.random.default_rng(1).uniform(1, 5, (80, 80)).astype(np.float32)
    depth[:, :40] = 0.0
    sparse = sample_sparse(noise(80), depth, PAPER)
    points = sparse > 0
    assert points.sum() == point_count((80, 80), PAPER)
    np.testing.assert_array_equal(sparse[points], depth[points])


def test_fewer_pixels_with_depth_than_points_gives_them_all() -> None:
    depth = np.zeros((80, 80), np.float32)
    depth[10:14, 20:25] = 3.0
    np.testing.assert_array_equal(sample_sparse(noise(80), depth, PAPER), depth)
    assert not sample_sparse(noise(80), np.zeros_like(depth), PAPER).any()


def test_corners_come_first() -> None:
    image = np.zeros((100, 100, 3), np.uint8)
    squares = [(r, c) for r in (15, 55) for c in (15, 55)]
    for row, column in squares:
        image[row : row + 30, column : column + 30] = 255
    sparse = sample_sparse(image, np.ones((100, 100), np.float32), SparseSettings(16 / 10000))
    points = np.argwhere(sparse > 0)
    true_corners = np.array([(r + dr, c + dc) for r, c in squares for dr in (0, 29) for dc in (0, 29)])
    distance = np.abs(points[:, None] - true_corners[None]).max(axis=-1)
    assert (distance.min(axis=1) <= 2).all()  # every point lies at a corner
    assert (distance.min(axis=0) <= 2).all()  # and every corner has its point


def test_a_rich_texture_does_not_take_all_points() -> None:
    image = np.full((160, 160, 3), 100, np.uint8)
    image[:80] = noise(160)[:80]
    image[80:] += noise(160, seed=1)[80:] // 64
    points = sample_sparse(image, np.ones((160, 160), np.float32), PAPER) > 0
    assert points[80:].sum() >= 0.2 * points.sum()


def test_the_image_alone_decides() -> None:
    image, depth = noise(64), np.ones((64, 64), np.float32)
    first = sample_sparse(image, depth, PAPER)
    sample_sparse(noise(96), np.ones((96, 96), np.float32), PAPER)
    np.testing.assert_array_equal(sample_sparse(image, 2 * depth, PAPER), 2 * first)


def test_stage_two_writes_points_and_validity_and_leaves_finished_frames_alone(tmp_path: Path) -> None:
    paths = SequencePaths(tmp_path / "room")
    for kind in ("image", "ground_truth"):
        (paths.folder / kind).mkdir(parents=True)
    frame = ToySimulator().observe()
    for name in ("000000", "000001"):
        write_image(paths.file("image", name), frame.rgb)
        write_depth(paths.file("ground_truth", name), frame.depth)
    calls: list[tuple[int, int]] = []
    sample_sequences([paths], PAPER, lambda stage, done, total: calls.append((done, total)))
    sparse, valid = (read_depth(paths.file(kind, "000001")) for kind in ("sparse_depth", "validity_map"))
    np.testing.assert_array_equal(valid, (sparse > 0).astype(np.float32))
    assert calls == [(1, 2), (2, 2)]
    before = {path: path.stat().st_mtime_ns for path in paths.folder.rglob("*.png")}
    paths.file("validity_map", "000000").unlink()
    sample_sequences([paths], PAPER)
    changed = {path.parent.name + path.stem for path, time in before.items() if path.stat().st_mtime_ns != time}
    assert changed == {"sparse_depth000000", "validity_map000000"}


def test_frames_are_handed_to_the_threads_in_shares(tmp_path, monkeypatch):
    """So that what waits in the pool does not grow with the number of frames."""
    begun, ahead = [], []
    monkeypatch.setattr(sparse, "_unsampled", lambda paths: [f"{number:06d}" for number in range(1000)])
    monkeypatch.setattr(sparse, "_sample_frame", lambda paths, frame, settings: begun.append(frame))
    report = lambda stage, done, total: ahead.append(len(begun) - done)  # noqa: E731
    sample_sequences([SequencePaths(tmp_path)], PAPER, report)
    assert len(begun) == len(set(begun)) == len(ahead) == 1000
    assert max(ahead) < 256
