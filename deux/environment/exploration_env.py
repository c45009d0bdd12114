"""The simulator as a Gymnasium environment, for policies that learn to explore."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces

from deux.configuration import compose
from deux.contracts import COLOR, DEPTH, Channel, Channels, Episode, Need, Reward, Robot, SceneReference, SceneSource
from deux.environment.egocentric import Crops
from deux.environment.memory import MOVES, ExplorationMemory
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError, check_range
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.simulation import Simulation
from deux.simulator.starts import random_starts

Extra = Literal["depth", "rgb"]


class ExplorationEnv(gymnasium.Env[dict[str, np.ndarray], np.int64]):
    """Gymnasium environment in which a robot explores scenes; `deux/Exploration-v0`.

    Actions are `MOVES`: 0 forward, 1 left, 2 right. Observations are a dictionary: "near" and "far", crops of the map
    that the robot made so far, its heading up (`deux.environment.egocentric`); "body", its last move and whether
    something was in the way; and if they are asked for "depth", 1 x H x W uint8 (0 none, 255 the camera's greatest
    depth), and "rgb", 3 x H x W uint8. Only what is asked for is rendered. `info` holds "area_seen" (square metres of
    the map that are known), "collided" and "scene". An episode is truncated after its steps and never terminated.

    Maps and pictures are uint8 in [0, 255], channels first, which stable-baselines3 takes for images. Its own network
    for dictionaries ("MultiInputPolicy") works with the defaults and every extra. It wants 36 pixels or more along each
    edge: smaller crops or cameras need a features extractor of one's own, such as that of `task=train_explorer`.

    Args:
        scenes: where the episodes take place, drawn at random; or a number of training scenes of the default source.
            `reset(options={"scene": i})` chooses one.
        reward: a registered reward by name, or one made beforehand.
        reward_options: options of the reward that is named.
        extras: what the observation holds besides maps and body.
        steps: actions in an episode.
        camera: the robot's; 64 x 64 pixels are enough for a map with cells of 0.1 m.
        robot: its body and motion.
        crops: the size of the crops.
        pool: scenes that are loaded already, to share with other environments of the process; it has the camera and
            the robot.
        render_mode: "rgb_array" makes `render` return what the robot's camera sees.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        scenes: Sequence[SceneReference] | int = 16,
        reward: str | Reward = "coverage",
        reward_options: Mapping[str, Any] | None = None,
        extras: Sequence[Extra] = (),
        steps: int = 500,
        camera: Camera | None = None,
        robot: Robot | None = None,
        crops: Crops | None = None,
        pool: ScenePool | None = None,
        render_mode: str | None = None,
    ) -> None:
        if isinstance(scenes, int):
            scenes = _default_scenes(scenes)
        if unknown := set(extras) - {"depth", "rgb"}:
            raise DeuxError(f"extras has {sorted(unknown)[0]!r} in it: it can hold depth and rgb.")
        if not scenes:
            raise DeuxError("the environment has no scene to explore: at least one is needed.")
        check_range("steps", steps, 1)
        self.render_mode = render_mode
        self.reward = registry().create("rewards", reward, reward_options or {}) if isinstance(reward, str) else reward
        self._labels = Need.LABELS in self.reward.needs
        self._scenes = scenes
        self._extras = frozenset(extras)
        self._steps = steps
        self._crops = crops or Crops()
        drawn = "rgb" in self._extras or render_mode is not None
        self._pool = pool or ScenePool(_default_simulation(camera or Camera(64, 64), robot or Robot()), drawn)
        if drawn and not self._pool.colors:
            raise DeuxError("the pool's scenes are without colours: they need ScenePool(..., colors=True).")
        self._camera, self._robot = self._pool.simulation.camera, self._pool.simulation.robot
        self._channels: Channels = (COLOR if "rgb" in self._extras else DEPTH) | (
            {Channel.LABELS} if self._labels else frozenset()
        )
        self.observation_space: spaces.Space[dict[str, np.ndarray]] = self._space()
        self.action_space = spaces.Discrete(len(MOVES))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode at a random place of some scene, on one of the floors that the simulator offers.

        Args:
            seed: of this and the following episodes.
            options: "scene", the number of the scene; "steps", the length of this episode.

        Raises:
            DeuxError: there is no such scene, or it has not what the reward needs.
        """
        super().reset(seed=seed)
        options = options or {}
        index = int(options.get("scene", self.np_random.integers(len(self._scenes))))
        if not 0 <= index < len(self._scenes):
            raise DeuxError(f"there is no scene {index}: the environment has {len(self._scenes)}, from 0.")
        self._length = int(options.get("steps", self._steps))
        self.simulator = self._pool.simulator(self._scenes[index])
        floors = len(self.simulator.floors)
        floor = int(self.np_random.integers(floors)) if floors > 1 else 0
        self.simulator.reset(*random_starts(self.simulator.free_space(floor), 1, self.np_random)[0], floor)
        self.memory = ExplorationMemory(self._camera, self._robot, self._crops)
        names = self.simulator.label_names if self._labels else ()
        episode_seed = int(self.np_random.integers(2**31))
        self.reward.reset(
            Episode(episode_seed, self._length, self._camera, self._robot, label_names=names, floor=floor)
        )
        self._step = 0
        observation, _ = self._look(collided=False)
        return observation, self._info(collided=False)

    def step(self, action: np.int64) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Carry out one of `MOVES`."""
        move = MOVES[int(action)]
        self.memory.acted(move)
        collided = self.simulator.step(move)
        self._step += 1
        observation, reward = self._look(collided)
        return observation, reward, False, self._step >= self._length, self._info(collided)

    def reward_state(self) -> dict[str, np.ndarray]:
        """What the reward learned so far (`Reward.state`)."""
        return self.reward.state()

    def load_reward_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Let the reward go on from an earlier `reward_state`."""
        self.reward.load_state(state)

    def render(self) -> np.ndarray | None:
        """What the robot's camera sees, H x W x 3 uint8, if the render mode is "rgb_array"."""
        return self.simulator.observe().rgb if self.render_mode == "rgb_array" else None

    def _look(self, collided: bool) -> tuple[dict[str, np.ndarray], float]:
        """Map what is seen and return the observation with its reward."""
        frame = self.simulator.observe(self._channels)
        experience = self.memory.experience(frame, collided)
        view = dict(experience.view)
        reward = float(self.reward(experience))
        if "depth" in self._extras:
            view["depth"] = (frame.depth * (255.0 / self._camera.max_depth)).astype(np.uint8)[None]
        if "rgb" in self._extras:
            view["rgb"] = np.ascontiguousarray(np.moveaxis(frame.rgb, 2, 0))
        return view, reward

    def _info(self, collided: bool) -> dict[str, Any]:
        return {"area_seen": self.memory.area, "collided": collided, "scene": self.simulator.scene.name}

    def _space(self) -> spaces.Space[dict[str, np.ndarray]]:
        camera = self._camera
        crop = spaces.Box(0, 255, self._crops.shape, np.uint8)
        found: dict[str, spaces.Space[Any]] = {"near": crop, "far": crop}
        found["body"] = spaces.Box(0.0, 1.0, (len(MOVES) + 1,), np.float32)
        if "depth" in self._extras:
            found["depth"] = spaces.Box(0, 255, (1, camera.height, camera.width), np.uint8)
        if "rgb" in self._extras:
            found["rgb"] = spaces.Box(0, 255, (3, camera.height, camera.width), np.uint8)
        return spaces.Dict(found)  # type: ignore[return-value]


def _default_scenes(count: int) -> Sequence[SceneReference]:
    """Training scenes of the source that the configuration chooses by default."""
    source: SceneSource = registry().choose("scenes", compose([f"scenes.train={count}"]).scenes).create()
    return source.splits().train


def _default_simulation(camera: Camera, robot: Robot) -> Simulation:
    """Makes the simulators that the configuration chooses by default."""
    return Simulation(camera, robot, registry().choose("simulators", compose().simulator))
