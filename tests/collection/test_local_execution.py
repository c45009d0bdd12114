"""Processes of one machine: the same frames for any number of them, and what becomes of a run when one fails."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import pytest
import torch
from mesh_world import signed_room
from toy_world import ToyScene, ToySimulator, convolving_predictor, tree

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.jobs import Executor, run_here
from deux.collection.local_execution import LocalExecutor
from deux.contracts import Explorer
from deux.errors import DeuxError
from deux.registry import registry
from deux_plugins.uncertainties.photometric import L1Residual

STEPS = 6


def plans(folder: Path) -> list[EpisodePlan]:
    """Three episodes in three rooms: two jobs of at most two robots."""
    return [EpisodePlan(folder / f"room-{i}", ToyScene(f"room{i}", "x" * i), seed=i, steps=STEPS) for i in range(3)]


def make_explorer(name: str) -> Explorer:
    made: Explorer = registry().create("explorers", name, {})
    return made


def collect(folder: Path, explorer: str, execute: Executor, make_simulator=ToySimulator) -> None:
    explore(
        plans(folder),
        make_simulator,
        partial(make_explorer, explorer),
        convolving_predictor(),
        uncertainty=L1Residual(),
        batch_size=2,
        execute=execute,
    )


@pytest.fixture
def two_threads() -> Iterator[None]:
    """Two threads in this process, and so one in each of two others."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


class SignedRooms:
    """Makes signed rooms; where it comes to another process, it leaves the numbers of threads there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __setstate__(self, state: dict) -> None:
        self.__dict__ = state
        threads = f"{torch.get_num_threads()} {cv2.getNumThreads()} {os.environ['LP_NUM_THREADS']}"
        (self.folder / f"threads {os.getpid()}").write_text(threads)

    def __call__(self, scene: ToyScene) -> ToySimulator:
        return signed_room(self.folder, scene)


@pytest.mark.slow
@pytest.mark.parametrize("explorer", ["random", "frontier", "deux"])
def test_the_frames_are_the_same_for_any_number_of_processes(explorer, tmp_path, two_threads):
    collect(tmp_path / "one", explorer, run_here)
    collect(tmp_path / "two", explorer, LocalExecutor(2))
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


def test_the_robots_of_one_batch_are_shared_out_on_a_cpu(tmp_path, two_threads, monkeypatch):
    """And processes share the threads of the first."""
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.delenv("LP_NUM_THREADS", raising=False)
    rooms = tmp_path / "rooms"
    rooms.mkdir()
    told: list[int] = []
    for folder, execute in {"one": run_here, "two": LocalExecutor(2)}.items():
        told.clear()
        explore(
            plans(tmp_path / folder),
            SignedRooms(rooms),
            partial(make_explorer, "deux"),
            convolving_predictor(),
            uncertainty=L1Residual(),
            batch_size=4,
            execute=execute,
            progress=lambda stage, done, total: told.append(done),
        )
    assert tree(tmp_path / "one") == tree(tmp_path / "two")
    assert torch.get_num_threads() == 2
    assert told == sorted(told)
    assert told[-1] == 3 * STEPS
    assert len(told) > STEPS  # they are counted as they come
    signs = [path.name.split(" ") for path in rooms.iterdir()]
    others = {name: process for name, process in signs if process != str(os.getpid())}
    assert others["room0"] == others["room1"] != others["room2"]
    assert {path.read_text() for path in rooms.glob("threads *")} == {"1 1 1"}


class Deadly(ToySimulator):
    """Kills its process at the third frame in one of the rooms."""

    def _frame(self, pose, channels):
        if self.scene.name == "room2" and self.rendered == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return super()._frame(pose, channels)


def test_a_dead_process_is_reported_in_one_sentence_and_its_episode_goes_on(tmp_path):
    sentence = "The process that worked on room-2 was killed by SIGKILL, .* run the same command again"
    with pytest.raises(DeuxError, match=sentence):
        collect(tmp_path / "cut", "deux", LocalExecutor(2), Deadly)
    assert not (tmp_path / "cut" / "room-2" / "episode.json").exists()
    collect(tmp_path / "cut", "deux", run_here)
    collect(tmp_path / "whole", "deux", run_here)
    assert tree(tmp_path / "cut") == tree(tmp_path / "whole")


def closed_room(scene: ToyScene) -> ToySimulator:
    if scene.name == "room1":
        raise DeuxError("room1 is closed.")
    return ToySimulator(replace(scene))


@pytest.mark.slow
def test_a_mistake_in_a_process_is_reported_as_it_is(tmp_path):
    with pytest.raises(DeuxError, match=r"^room1 is closed\.$"):
        collect(tmp_path, "random", LocalExecutor(2), closed_room)


def test_one_job_needs_no_other_process(tmp_path):
    made: list[ToySimulator] = []

    def make_simulator(scene: ToyScene) -> ToySimulator:  # which cannot be pickled
        made.append(ToySimulator(scene))
        return made[-1]

    explore(plans(tmp_path)[:1], make_simulator, partial(make_explorer, "random"), execute=LocalExecutor(2))
    assert made[0].rendered == STEPS
