"""One robot's episode: its simulator, its explorer and its files."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from deux.contracts import Action, Episode, Explorer, Frame, Need, Observation, Simulator
from deux.data.atomic import write_atomically, write_json
from deux.data.frames import FrameWriter, prepare_folders, read_frame
from deux.data.images import quantise_depth
from deux.data.layout import SequencePaths
from deux.data.perception import SOURCES, Percept
from deux.errors import DeuxError
from deux.simulator.starts import random_starts


class SceneLike(Protocol):
    """What the data pipeline asks of a scene: names only. Whoever makes the simulators knows how to load it."""

    @property
    def name(self) -> str:
        """Short, unique within a dataset; part of file names."""

    @property
    def identity(self) -> str:
        """What made the scene; part of the dataset's hash."""


MakeSimulator = Callable[[Any], Simulator]
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
    scene: SceneLike
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
        self.explorer = explorer
        self.over = False
        self.history: list[Frame] = []
        """The latest frames, newest first."""
        self._writer = writer
        self._labels = Need.LABELS in explorer.needs
        self._collided = False
        self._actions: list[Action] = []
        self._uncertainty: list[float] = []
        free_space = simulator.free_space()
        self._start = random_starts(free_space, 1, np.random.default_rng(plan.seed))[0]
        prepare_folders(plan.paths, simulator.camera.intrinsics, self._labels)
        simulator.reset(*self._start)
        shown = free_space if Need.FREE_SPACE in explorer.needs else None
        names = simulator.label_names if self._labels else ()
        explorer.reset(Episode(plan.seed, plan.steps, simulator.camera, simulator.robot, shown, names))

    @property
    def step(self) -> int:
        """Number of actions taken so far."""
        return len(self._actions)

    def observe(self) -> None:
        """Take the next frame, from disk if it is there.

        Raises:
            DeuxError: the frame on disk was taken from another pose than the robot's.
        """
        frame = read_frame(self.plan.paths, self.step, self._labels)
        if frame is None:
            seen = self.simulator.observe(labels=self._labels)
            labels = seen.labels if self._labels else None
            frame = Frame(seen.rgb.copy(), quantise_depth(seen.depth), seen.pose.copy(), labels)
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
        action = self.explorer.act(self._observation(percept))
        self._actions.append(action)
        if action == Action.STOP or self.step == self.plan.steps:
            self.over = True
        else:
            self._collided = self.simulator.step(action)

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
            "start": [float(value) for value in self._start],
            "actions": [int(action) for action in self._actions],
        }
        write_json(self.plan.record, record)

    def _observation(self, percept: Percept | None) -> Observation:
        """Exactly what the explorer declared, in arrays of its own."""
        needs, frame = self.explorer.needs, self.history[0]
        predicted = percept if Need.PREDICTED_DEPTH in needs else None
        judged = percept if Need.RESIDUAL in needs else None
        return Observation(
            step=self.step,
            pose=frame.pose.copy(),
            collided=self._collided,
            rgb=frame.rgb.copy(),
            sensor_depth=frame.depth.copy() if Need.SENSOR_DEPTH in needs else None,
            predicted_depth=predicted.predicted_depth if predicted else None,
            residual=judged.residual if judged else None,
            uncertainty=judged.uncertainty if judged else None,
            labels=frame.labels.copy() if frame.labels is not None else None,
        )

    def _write_map(self) -> None:
        known = self.explorer.map()
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
