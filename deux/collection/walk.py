"""An explorer in a simulator: what it is told and shown, and what it does. No file is touched here."""

import numpy as np

from deux.collection.perception import Percept
from deux.contracts import COLOR, Action, Channel, Episode, Explorer, Frame, Need, Observation, Simulator
from deux.io.images import quantise_depth
from deux.simulator.starts import random_starts


class Walk:
    """One episode of one explorer, from its start: whoever looks on calls `frame` and `act` in turn until it is `over`.

    Args:
        simulator: where it takes place.
        explorer: who chooses.
        seed: of the start and of the explorer.
        steps: number of actions; the last one is not carried out, as no frame would follow it.
    """

    def __init__(self, simulator: Simulator, explorer: Explorer, seed: int, steps: int) -> None:
        self.simulator = simulator
        self.explorer = explorer
        self.steps = steps
        self.over = False
        self.collided = False
        """Whether the last action was cut short by an obstacle."""
        self.actions: list[Action] = []
        """What was chosen so far."""
        self.labels = Need.LABELS in explorer.needs
        """Whether the explorer is shown labels."""
        free_space = simulator.free_space()
        self.start = random_starts(free_space, 1, np.random.default_rng(seed))[0]
        """Where it began: world x and z in metres, and the heading in radians."""
        simulator.reset(*self.start)
        shown = free_space if Need.FREE_SPACE in explorer.needs else None
        names = simulator.label_names if self.labels else ()
        explorer.reset(Episode(seed, steps, simulator.camera, simulator.robot, shown, names))

    @property
    def step(self) -> int:
        """Number of actions chosen so far."""
        return len(self.actions)

    def frame(self) -> Frame:
        """What the robot's camera sees now, in arrays of its own, the depth as the files of a dataset hold it."""
        seen = self.simulator.observe(COLOR | {Channel.LABELS} if self.labels else COLOR)
        return Frame(seen.rgb.copy(), quantise_depth(seen.depth), seen.pose.copy(), seen.labels)

    def act(self, frame: Frame, percept: Percept | None = None) -> None:
        """Let the explorer choose an action, and carry it out.

        Args:
            frame: what it sees.
            percept: what the depth model sees; None if the explorer does not need it.
        """
        action = self.explorer.act(self._observation(frame, percept))
        self.actions.append(action)
        if action == Action.STOP or self.step == self.steps:
            self.over = True
        else:
            self.collided = self.simulator.step(action)

    def _observation(self, frame: Frame, percept: Percept | None) -> Observation:
        """Exactly what the explorer declared, in arrays of its own."""
        needs = self.explorer.needs
        predicted = percept if Need.PREDICTED_DEPTH in needs else None
        judged = percept if Need.RESIDUAL in needs else None
        return Observation(
            step=self.step,
            pose=frame.pose.copy(),
            collided=self.collided,
            rgb=frame.rgb.copy(),
            sensor_depth=frame.depth.copy() if Need.SENSOR_DEPTH in needs else None,
            predicted_depth=predicted.predicted_depth if predicted else None,
            residual=judged.residual if judged else None,
            uncertainty=judged.uncertainty if judged else None,
            labels=frame.labels.copy() if frame.labels is not None else None,
        )
