"""Recordings of explorations, read back by Rerun's own reader."""

from pathlib import Path

import numpy as np

from deux.collection.walk import Walk, run_walks
from deux.contracts import Action, Episode, Explorer, ExplorerMap, Observation
from deux.figures.exploration_recording import ExplorationRecording
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.testing.box_world import Box, BoxWorld


class Mapper(Explorer):
    """Goes straight on; its map grows by two columns to the left at each step, free but for one unknown cell."""

    def __init__(self, keeps_map: bool = True) -> None:
        self.keeps_map = keeps_map

    def reset(self, episode: Episode) -> None:
        self.steps = 0

    def act(self, observation: Observation) -> Action:
        self.steps += 1
        return Action.FORWARD

    def map(self) -> ExplorerMap | None:
        if not self.keeps_map:
            return None
        frame = GridFrame(1.0 - 0.2 * self.steps, 2.0, 6, 4 + 2 * self.steps, 0.1)
        occupancy = np.full(frame.shape, 2, np.int8)
        occupancy[0, 0] = 0
        field = np.where(occupancy == 2, np.float32(0.25), np.float32(np.nan))
        return ExplorerMap(frame, occupancy, field, target=(1.0, 2.3))


def write(path: Path, explorer: Explorer, steps: int = 4) -> np.ndarray:
    """Record a walk; the robot's world x and z at each step."""
    world = BoxWorld(4.0, 5.0, (Box(0.5, 0.5, 1.0, 1.2, 0.8),), Camera(24, 16))
    places = []
    with ExplorationRecording(path, "walk") as recording:
        for (step,) in run_walks([Walk(world, explorer, seed=0, steps=steps)]):
            recording.add(step)
            places.append(step.frame.pose[[0, 2], 3])
    return np.array(places)


def pixels(found: dict, entity: str, number: int, component: str = "Points2D:positions") -> np.ndarray:
    return np.array(found[entity][number][component])


def picture(found: dict, entity: str, number: int, shape: tuple[int, int]) -> np.ndarray:
    return np.frombuffer(bytes(found[entity][number]["Image:buffer"][0]), np.uint8).reshape(*shape, 3)


def test_map_path_frontiers_target_and_field_lie_on_one_canvas(tmp_path: Path, read_recording) -> None:
    places = write(tmp_path / "a.rrd", Mapper())
    found = read_recording(tmp_path / "a.rrd")
    margin = 5  # cells around what is known in the end, 6 x 12 of them
    left, top, shape = 1.0 - 0.2 * 4 - 0.1 * margin, 2.0 - 0.1 * margin, (6 + 2 * margin, 12 + 2 * margin)
    for number in range(4):
        cells = picture(found, "/map", number, shape)[margin:-margin, margin:-margin]
        columns = 4 + 2 * (number + 1)
        assert (cells[1:, -columns:] == cells[-1, -1]).all()  # free
        assert (cells[:, : 12 - columns] == cells[0, -columns]).all()  # unknown
        np.testing.assert_allclose(
            pixels(found, "/map/target", number), [[(1.0 - left) / 0.1, (2.3 - top) / 0.1]], atol=1e-4
        )
        path = np.array(found["/map/path"][number]["LineStrips2D:strips"][0])
        np.testing.assert_allclose(path, (places[: number + 1] - (left, top)) / 0.1, atol=1e-4)
        frontiers = {tuple(place) for place in pixels(found, "/map/frontiers", number)}
        corner = 12 - columns
        assert {(margin + corner + 1.5, margin + 0.5), (margin + corner + 0.5, margin + 1.5)} <= frontiers
        field = picture(found, "/field", number, shape)[margin:-margin, margin:-margin]
        assert (field[0, corner] == 217).all()
        assert not (field[1, corner] == 217).all()
    assert len(found["/image"]) == len(found["/depth"]) == 4
    assert "/uncertainty" not in found


def test_an_explorer_without_a_map_is_shown_on_the_true_one(tmp_path: Path, read_recording) -> None:
    write(tmp_path / "a.rrd", Mapper(keeps_map=False), steps=2)
    found = read_recording(tmp_path / "a.rrd")
    assert len(found["/map"]) == 2
    assert len(set(found["/map"][1]["Image:buffer"][0])) > 3  # free, occupied and unknown
    assert found["/map/target"][1].get("Points2D:positions", []) == []
    assert "/field" not in found
