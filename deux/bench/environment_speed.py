"""Benchmark of the Gymnasium environment in which explorers are trained."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from deux.bench.bench_scenes import default_simulation, flats
from deux.bench.installed_plugins import installed
from deux.bench.speed_tables import SpeedTable
from deux.bench.timing import Spread, in_turn, rate, times_the_slowest
from deux.contracts import Reward
from deux.environment.exploration_env import ExplorationEnv, Extra
from deux.environment.memory import MOVES
from deux.environment.scene_pool import ScenePool


@dataclass(frozen=True)
class EnvironmentSettings:
    """Settings of the benchmark of the environment.

    Args:
        size: width and height of the images in pixels.
        episode: number of steps in an episode; the reset between episodes is part of the measured time.
        rounds: number of measurements of each environment.
        seconds: duration of each measurement.
    """

    size: int = 64
    episode: int = 500
    rounds: int = 6
    seconds: float = 1.0


QUICK = EnvironmentSettings(rounds=3, seconds=0.2)
"""Settings for a quick test."""


def measure_environment(settings: EnvironmentSettings) -> Iterator[SpeedTable]:
    """Measure the environment with every installed reward and with each optional entry of the observations."""
    rewards, broken = installed("rewards")
    plain = next((name for name, reward in rewards.items() if not reward.needs), None)
    ways: list[tuple[str, Sequence[Extra]]] = [(name, ()) for name in rewards]
    if plain is not None:
        ways += [(plain, ("depth",)), (plain, ("rgb",))]
    pool = ScenePool(default_simulation(settings.size))
    steps = {way: _stepper(rewards[way[0]], way[1], pool, settings.episode) for way in ways}
    for step in steps.values():  # warm-up: compiles the kernels
        step()
    rates = in_turn(
        {way: lambda step=step: rate(step, settings.seconds) for way, step in steps.items()},  # type: ignore[misc]
        settings.rounds,
    )
    ratios = times_the_slowest(rates)
    rows = tuple(
        {
            "reward": name,
            "observation": ", ".join(["maps", *extras]),
            "labels": "yes" if rewards[name].needs else "no",
            "steps per second": Spread.of(rates[name, extras]),
            "times the slowest": ratios[name, extras],
        }
        for name, extras in ways
    )
    note = "One environment in one process, random moves; resets and the computation of rewards are included."
    title = f"Environment: steps in a generated flat, depth images of {settings.size} x {settings.size}"
    yield SpeedTable("environment", title, rows, (note, *broken))


def _stepper(reward: Reward, extras: Sequence[Extra], pool: ScenePool, episode: int) -> Callable[[], None]:
    """Create a function that executes one random step and resets the environment after an episode."""
    environment = ExplorationEnv(flats(1), reward, extras=extras, steps=episode, pool=pool)
    environment.reset(seed=0)
    rng = np.random.default_rng(0)

    def step() -> None:
        move = rng.choice(len(MOVES), p=[0.6, 0.2, 0.2])
        if environment.step(np.int64(move))[3]:
            environment.reset()

    return step
