"""Gymnasium environment of the simulator, for reinforcement learning of exploration policies."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces

from deux.broken_contracts import broken_contract
from deux.configuration import compose
from deux.contracts import (
    COLOR,
    DEPTH,
    Channel,
    Channels,
    Episode,
    Experience,
    Need,
    Reward,
    Robot,
    Scene,
    SceneReference,
    SceneSource,
)
from deux.environment.egocentric import Crops
from deux.environment.memory import MOVES, ExplorationMemory
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError, check_range, near_matches, shown
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.scenes.splits import splits_of
from deux.simulator.simulation import Simulation
from deux.simulator.starts import random_starts

Extra = Literal["depth", "rgb"]


class ExplorationEnv(gymnasium.Env[dict[str, np.ndarray], np.int64]):
    """Gymnasium environment in which a robot explores scenes; `deux/Exploration-v0`.

    The actions are `MOVES`: 0 forward, 1 left, 2 right. Observations are dictionaries: "near" and "far" are egocentric
    crops of the robot's map (`deux.environment.egocentric`), "body" is the last move and whether it collided, and the
    optional extras are "depth", 1 x H x W uint8 (0 none, 255 the camera's maximum depth), and "rgb", 3 x H x W uint8.
    Only the selected extras are rendered. `info` contains "area_seen" (known area of the map in square metres),
    "collided" and "scene". Episodes are truncated after their steps and never terminated.

    Maps and images are uint8 in [0, 255], channels first, which stable-baselines3 treats as images. Its policy for
    dictionaries ("MultiInputPolicy") works with the defaults and all extras, but needs 36 pixels or more along each
    edge: smaller crops or cameras need a custom features extractor, such as that of `task=train_explorer`.

    Args:
        scenes: scenes of the episodes, sampled at random; or a number of training scenes of the default source.
            `reset(options={"scene": i})` selects one.
        reward: name of a registered reward, or a reward object.
        reward_options: options of a reward given by name.
        extras: additional observations.
        steps: number of actions in an episode.
        camera: camera of the robot; 64 x 64 pixels are enough for a map with cells of 0.1 m.
        robot: body and motion of the robot.
        crops: sizes of the map crops.
        pool: cache of loaded scenes, shared with other environments of the process; it also defines the camera and the
            robot, which must then be None.
        render_mode: with "rgb_array", `render` returns the image of the robot's camera.

    Raises:
        DeuxError: an argument is invalid, or the reward needs data that the environment does not have.
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
        scenes = _references(scenes)
        if unknown := {extras} if isinstance(extras, str) else set(extras) - {"depth", "rgb"}:
            raise DeuxError(f"extras contains {sorted(unknown)[0]!r}: it must be a list of depth and rgb.")
        check_range("steps", steps, 1)
        _check_robot(camera, robot, pool)
        self.render_mode = render_mode
        self.reward = _create_reward(reward, reward_options)
        self._labels = Need.LABELS in self.reward.needs
        self._scenes = scenes
        self._extras = frozenset(extras)
        self._steps = steps
        self._crops = crops or Crops()
        colors = "rgb" in self._extras or render_mode is not None
        self._pool = pool or ScenePool(_default_simulation(camera or Camera(64, 64), robot or Robot()), colors)
        if colors and not self._pool.colors:
            raise DeuxError("the scenes of the pool have no colours: create it with ScenePool(..., colors=True).")
        self._camera, self._robot = self._pool.simulation.camera, self._pool.simulation.robot
        self._channels: Channels = (COLOR if "rgb" in self._extras else DEPTH) | (
            {Channel.LABELS} if self._labels else frozenset()
        )
        self.observation_space: spaces.Space[dict[str, np.ndarray]] = self._space()
        self.action_space = spaces.Discrete(len(MOVES))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode at a random position of a random scene and floor.

        Args:
            seed: random seed of this and the following episodes.
            options: "scene", the index of the scene; "steps", the length of this episode.

        Raises:
            DeuxError: an option or the scene does not exist, or the scene lacks data that the reward needs.
        """
        super().reset(seed=seed)
        options = options or {}
        for unknown in options.keys() - {"scene", "steps"}:
            raise DeuxError(f"reset has no option {unknown!r}: {near_matches(unknown, ('scene', 'steps'))}")
        index = int(options.get("scene", self.np_random.integers(len(self._scenes))))
        if not 0 <= index < len(self._scenes):
            raise DeuxError(f"there is no scene {index}: the environment has {len(self._scenes)}, from 0.")
        self._length = int(options.get("steps", self._steps))
        check_range("steps", self._length, 1)
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
        """Execute one of `MOVES`.

        Raises:
            DeuxError: the action does not exist, or the reward is not a finite number.
        """
        if not self.action_space.contains(action):
            moves = ", ".join(f"{number} for {move.name}" for number, move in enumerate(MOVES))
            raise DeuxError(f"the action is {shown(action)}: it must be a whole number, {moves}.")
        move = MOVES[int(action)]
        self.memory.acted(move)
        collided = self.simulator.step(move)
        self._step += 1
        observation, reward = self._look(collided)
        return observation, reward, False, self._step >= self._length, self._info(collided)

    def reward_state(self) -> dict[str, np.ndarray]:
        """Learned state of the reward, see `Reward.state`."""
        return self.reward.state()

    def load_reward_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore the reward from an earlier `reward_state`."""
        self.reward.load_state(state)

    def render(self) -> np.ndarray | None:
        """Image of the robot's camera, H x W x 3 uint8, if the render mode is "rgb_array"."""
        return self.simulator.observe().rgb if self.render_mode == "rgb_array" else None

    def _look(self, collided: bool) -> tuple[dict[str, np.ndarray], float]:
        """Observe, update the map, and return the observation with its reward."""
        frame = self.simulator.observe(self._channels)
        experience = self.memory.experience(frame, collided)
        view = dict(experience.view)
        reward = self._reward_of(experience)
        if "depth" in self._extras:
            view["depth"] = (frame.depth * (255.0 / self._camera.max_depth)).astype(np.uint8)[None]
        if "rgb" in self._extras:
            view["rgb"] = np.ascontiguousarray(np.moveaxis(frame.rgb, 2, 0))
        return view, reward

    def _reward_of(self, experience: Experience) -> float:
        """Compute the reward and check that it is finite, since NaN would destroy the policy's weights."""
        value: Any = self.reward(experience)
        if getattr(value, "shape", ()) == () and not isinstance(value, str) and hasattr(value, "__float__"):
            number = float(value)
            if math.isfinite(number):
                return number
        raise broken_contract(self.reward, f"{shown(value)} at step {self._step}", "a finite number")

    def _info(self, collided: bool) -> dict[str, Any]:
        return {"area_seen": self.memory.area, "collided": collided, "scene": self.simulator.scene.name}

    def _space(self) -> spaces.Space[dict[str, np.ndarray]]:
        camera = self._camera
        crop = spaces.Box(0, 255, self._crops.shape, np.uint8)
        parts: dict[str, spaces.Space[Any]] = {"near": crop, "far": crop}
        parts["body"] = spaces.Box(0.0, 1.0, (len(MOVES) + 1,), np.float32)
        if "depth" in self._extras:
            parts["depth"] = spaces.Box(0, 255, (1, camera.height, camera.width), np.uint8)
        if "rgb" in self._extras:
            parts["rgb"] = spaces.Box(0, 255, (3, camera.height, camera.width), np.uint8)
        return spaces.Dict(parts)  # type: ignore[return-value]


def _references(scenes: Any) -> Sequence[SceneReference]:
    """The given scenes, or that many training scenes of the default source."""
    if hasattr(scenes, "__index__") and not isinstance(scenes, bool):
        scenes = _default_scenes(int(scenes))
    valid = isinstance(scenes, Sequence) and all(isinstance(scene, SceneReference | Scene) for scene in scenes)
    if not valid or isinstance(scenes, str):
        raise DeuxError(
            f"scenes is {shown(scenes)}: it must be a number of scenes, or a list of references to scenes, such as the "
            "splits().train of a source."
        )
    if not scenes:
        raise DeuxError("the environment has no scene to explore: at least one is needed.")
    return scenes


def _check_robot(camera: Any, robot: Any, pool: ScenePool | None) -> None:
    for name, value, cls in (("camera", camera, Camera), ("robot", robot, Robot)):
        if value is None:
            continue
        if pool is not None:
            raise DeuxError(f"the pool has a {name} already: make the pool's Simulation with the {name} that is meant.")
        if not isinstance(value, cls):
            raise DeuxError(f"{name} is {shown(value)}: it must be a {cls.__module__}.{cls.__name__}.")


def _create_reward(reward: Any, options: Mapping[str, Any] | None) -> Reward:
    """Create a reward by name, or check a given one; both must only need data that the environment has."""
    if isinstance(reward, str):
        result: Reward = registry().create("rewards", reward, options or {})
    elif isinstance(reward, Reward):
        result = reward
        if options:
            raise DeuxError(
                f"reward_options are only for rewards given by name, and {type(reward).__name__} is an object: pass "
                "them to its constructor."
            )
    else:
        raise DeuxError(
            f"reward is {shown(reward)}: it must be the name of a reward or an instance of a subclass of "
            "deux.contracts.Reward."
        )
    for need in sorted(result.needs - {Need.SENSOR_DEPTH, Need.LABELS}):
        raise DeuxError(
            f"the reward {type(result).__name__} needs {need}, which the environment does not have: rewards get the "
            "sensor depth, and labels if they declare Need.LABELS."
        )
    return result


def _default_scenes(count: int) -> Sequence[SceneReference]:
    """Training scenes of the default source of the configuration."""
    source: SceneSource = registry().choose("scenes", compose([f"scenes.train={count}"]).scenes).create()
    return splits_of(source).train


def _default_simulation(camera: Camera, robot: Robot) -> Simulation:
    """Factory of the default simulator of the configuration."""
    return Simulation(camera, robot, registry().choose("simulators", compose().simulator))
