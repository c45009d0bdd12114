"""One robot's episode on disk: what is planned, its frames as they come, and its record when it is over."""

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
"""Makes the simulator of a scene."""

MakeExplorer = Callable[[], Explorer]
"""Makes one explorer, for one episode."""


@dataclass(frozen=True)
class EpisodePlan(Plan):
    """An episode that is to be collected.

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
        """Where the sequence's files lie."""
        return SequencePaths(self.folder)

    @property
    def size(self) -> int:
        """Number of frames that it has at most."""
        return self.steps

    @property
    def finished(self) -> bool:
        """Whether the episode is over, and all of it on disk."""
        return self.record.exists()

    @property
    def record(self) -> Path:
        """The file that is written when the episode is over."""
        return self.folder / "episode.json"


class EpisodeFiles:
    """The files of an episode under way.

    Frames that an earlier run finished are read, all others written. For the two to agree exactly, a walk shows depth
    as the files hold it.

    Args:
        plan: the episode.
        camera: the robot's; its matrix becomes `K.txt`.
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
        """The frame of that number, or None where it must be rendered.

        Raises:
            DeuxError: the frame on disk was taken from another pose than the robot's.
        """
        frame = read_frame(self._plan.paths, number, self._labels)
        if frame is not None and not np.array_equal(frame.pose, pose):
            raise DeuxError(
                f"{self._plan.folder} cannot be continued: the robot now comes to another pose at step {number} than "
                "when that frame was written, so something that made it has changed; delete the folder."
            )
        return frame

    def add(self, step: Step) -> None:
        """Write the frame of a step, unless it was read, and keep its uncertainty."""
        if step.rendered:
            self._writer.put(self._plan.paths, step.number, step.frame)
        if step.percept is not None and step.percept.uncertainty is not None:
            self._uncertainty.append(step.percept.uncertainty)

    def finish(self, walk: Walk) -> None:
        """Write what is known only at the end, the record last. All frames must be on disk."""
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
    """Begin an episode, or go on with one of which some frames are on disk.

    Returns:
        The walk, and where its steps go.
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
