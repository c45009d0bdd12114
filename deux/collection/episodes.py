"""A robot's episode on disk: its plan, its frames as they are recorded, and its record at the end."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from deux.collection.explored_map import map_of
from deux.collection.free_floor import write_free_floor
from deux.collection.jobs import Plan
from deux.collection.walk import Step, Walk
from deux.contracts import Explorer, ExplorerMap, Frame, Need, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.atomic import write_atomically, write_json
from deux.io.frames import FrameWriter, prepare_folders, read_frame
from deux.io.layout import SequencePaths

MakeSimulator = Callable[[SceneReference], Simulator]
"""Creates the simulator of a scene."""

MakeExplorer = Callable[[], Explorer]
"""Creates an explorer, for one episode."""


@dataclass(frozen=True)
class EpisodePlan(Plan):
    """An episode to collect.

    Args:
        folder: where its sequence is written.
        scene: the scene it takes place in.
        seed: seed of its start and of the explorer.
        steps: number of actions, and of frames.
        floor: the floor of the scene, an index into `Simulator.floors`.
    """

    seed: int
    steps: int
    floor: int = 0

    @property
    def paths(self) -> SequencePaths:
        """The paths of the sequence's files."""
        return SequencePaths(self.folder)

    @property
    def size(self) -> int:
        """Maximal number of frames."""
        return self.steps

    @property
    def finished(self) -> bool:
        """Whether the whole episode is on disk."""
        return self.record.exists()

    @property
    def record(self) -> Path:
        """The file that is written at the end of the episode, after all others."""
        return self.folder / "episode.json"


class EpisodeFiles:
    """Reads and writes the files of an episode that is in progress.

    Frames that an earlier run wrote are read, all others are written. So that both are equal, a walk quantises depth as
    the files do.

    Args:
        plan: the episode.
        camera: the robot's camera; its intrinsics are written to `K.txt`.
        labels: whether the frames have labels.
        writer: writes the frames.
    """

    def __init__(self, plan: EpisodePlan, camera: Camera, labels: bool, writer: FrameWriter) -> None:
        self._plan = plan
        self._labels = labels
        self._writer = writer
        self._uncertainty: list[Tensor] = []
        prepare_folders(plan.paths, camera.intrinsics, labels)

    def read(self, number: int, pose: np.ndarray) -> Frame | None:
        """Read the frame of that number; None if it must be rendered.

        Raises:
            DeuxError: the frame on disk has another pose than the robot.
        """
        frame = read_frame(self._plan.paths, number, self._labels)
        if frame is not None and not np.array_equal(frame.pose, pose):
            raise DeuxError(
                f"{self._plan.folder} cannot be continued: at step {number}, the robot's pose differs from that of the "
                "frame written earlier, so something that determines it has changed; delete the folder."
            )
        return frame

    def add(self, step: Step) -> None:
        """Write the frame of a step, unless it was read, and remember its uncertainty."""
        if step.rendered:
            self._writer.put(self._plan.paths, step.number, step.frame)
        if step.percept is not None and step.percept.uncertainty is not None:
            self._uncertainty.append(step.percept.uncertainty)

    def finish(self, walk: Walk) -> None:
        """Write the files that follow the last frame, the record last. All frames must be on disk."""
        if self._uncertainty:
            values = torch.stack(self._uncertainty).tolist()
            rows = [f"{number},{value!r}" for number, value in enumerate(values)]
            text = "\n".join(["step,uncertainty", *rows, ""])
            write_atomically(self._plan.folder / "uncertainty.csv", text.encode())
        known = map_of(walk.explorer)
        if known is not None:
            _write_map(self._plan.folder / "map.npz", known)
        write_free_floor(self._plan.folder, walk.simulator.free_space(self._plan.floor))
        record = {
            "scene": self._plan.scene.name,
            "floor": self._plan.floor,
            "seed": self._plan.seed,
            "start": [float(value) for value in walk.start],
            "actions": [int(action) for action in walk.actions],
        }
        write_json(self._plan.record, record)


def begin_episode(
    plan: EpisodePlan, simulator: Simulator, explorer: Explorer, writer: FrameWriter
) -> tuple[Walk, EpisodeFiles]:
    """Begin an episode, or continue one of which some frames are on disk.

    Returns:
        The walk, and the files that its steps are added to.
    """
    files = EpisodeFiles(plan, simulator.camera, Need.LABELS in explorer.needs, writer)
    return Walk(simulator, explorer, plan.seed, plan.steps, plan.floor, files.read), files


def _write_map(path: Path, known: ExplorerMap) -> None:
    frame = known.frame
    arrays: dict[str, Any] = {
        "occupancy": known.occupancy,
        "origin": np.array([frame.origin_x, frame.origin_z]),
        "resolution": np.array(frame.resolution),
    }
    if known.uncertainty is not None:
        arrays["uncertainty"] = known.uncertainty
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    write_atomically(path, content.getvalue())
