"""One robot's episode: its simulator, its explorer and its files."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deux.collection.perception import SOURCES, Percept
from deux.collection.walk import Walk
from deux.contracts import Explorer, Frame, SceneReference, Simulator
from deux.errors import DeuxError
from deux.io.atomic import write_atomically, write_json
from deux.io.frames import FrameWriter, prepare_folders, read_frame
from deux.io.layout import SequencePaths

MakeSimulator = Callable[[SceneReference], Simulator]
"""Makes the simulator of a scene."""

MakeExplorer = Callable[[], Explorer]
"""Makes one explorer, for one episode."""


@dataclass(frozen=True)
class EpisodePlan:
    """An episode that is to be collected.

    Args:
        folder: where its sequence is written.
        scene: the scene it takes place in.
        seed: seed of its start and of the explorer.
        steps: number of actions, and of frames.
    """

    folder: Path
    scene: SceneReference
    seed: int
    steps: int

    @property
    def paths(self) -> SequencePaths:
        """Where the sequence's files lie."""
        return SequencePaths(self.folder)

    @property
    def record(self) -> Path:
        """The file that is written when the episode is over."""
        return self.folder / "episode.json"


class EpisodeRun:
    """An episode under way.

    Frames that an earlier run finished are read from disk and all others rendered, while simulator and explorer take
    every step: whatever is random in them then stands where it would stand in an uninterrupted run. For the two to
    agree exactly, everybody sees depth as the files hold it.
    """

    def __init__(self, plan: EpisodePlan, simulator: Simulator, explorer: Explorer, writer: FrameWriter) -> None:
        self.plan = plan
        self.simulator = simulator
        self.history: list[Frame] = []
        """The latest frames, newest first."""
        self._walk = Walk(simulator, explorer, plan.seed, plan.steps)
        self._writer = writer
        self._uncertainty: list[float] = []
        prepare_folders(plan.paths, simulator.camera.intrinsics, self._walk.labels)

    @property
    def step(self) -> int:
        """Number of actions taken so far."""
        return self._walk.step

    @property
    def over(self) -> bool:
        """Whether the episode has come to its end."""
        return self._walk.over

    def observe(self) -> None:
        """Take the next frame, from disk if it is there.

        Raises:
            DeuxError: the frame on disk was taken from another pose than the robot's.
        """
        frame = read_frame(self.plan.paths, self.step, self._walk.labels)
        if frame is None:
            frame = self._walk.frame()
            self._writer.put(self.plan.paths, self.step, frame)
        elif not np.array_equal(frame.pose, self.simulator.pose):
            raise DeuxError(
                f"{self.plan.folder} cannot be continued: the robot now comes to another pose at step {self.step} than "
                "when that frame was written, so something that made it has changed; delete the folder."
            )
        self.history = [frame, *self.history[:SOURCES]]

    def act(self, percept: Percept | None) -> None:
        """Let the explorer choose an action and carry it out.

        Args:
            percept: what the depth model sees; None if the explorer does not need it.
        """
        if percept is not None:
            self._uncertainty.append(percept.uncertainty)
        self._walk.act(self.history[0], percept)

    def finish(self) -> None:
        """Write what is known only at the end, the record last."""
        if self._uncertainty:
            rows = [f"{step},{value!r}" for step, value in enumerate(self._uncertainty)]
            text = "\n".join(["step,uncertainty", *rows, ""])
            write_atomically(self.plan.folder / "uncertainty.csv", text.encode())
        self._write_map()
        record = {
            "scene": self.plan.scene.name,
            "seed": self.plan.seed,
            "start": [float(value) for value in self._walk.start],
            "actions": [int(action) for action in self._walk.actions],
        }
        write_json(self.plan.record, record)

    def _write_map(self) -> None:
        known = self._walk.explorer.map()
        if known is None:
            return
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
        write_atomically(self.plan.folder / "map.npz", content.getvalue())
