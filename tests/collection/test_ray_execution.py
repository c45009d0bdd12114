"""Jobs on a Ray cluster: two machines, each a raylet of its own, of which one is killed now and then."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_world import GuessingModel, ToyScene, ToySimulator, Wanderer, guided_explorer, tree

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.jobs import ExplorationJob, JobRunner, run_here
from deux.collection.perception import Perception
from deux.contracts import Action, Episode, Explorer, Observation, Robot, Scene, SceneMesh, SceneReference
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.mesh_files.mesh_reader import read_mesh
from deux.scenes.mesh_scene import mesh_scene
from deux.simulator.mesh_simulator import MeshSimulator
from deux_plugins.uncertainties.photometric import L1Residual

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install -e '.[ray]'")
cluster_utils = pytest.importorskip("ray.cluster_utils")

from deux.collection.ray_execution import RayExecutor  # noqa: E402

pytestmark = pytest.mark.timeout(120)
STEPS = 24


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two machines with room for one worker each."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(Path(__file__).parent)  # where workers find what the tests are made of
    made = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        made.add_node(num_cpus=1)
        yield made
    finally:
        made.shutdown()
        os.environ.pop("PYTHONPATH")
        if before is not None:
            os.environ["PYTHONPATH"] = before


def plans(folder: Path, count: int, steps: int = STEPS) -> list[EpisodePlan]:
    return [EpisodePlan(folder / f"room-{i}", ToyScene(f"room{i}", "x" * i), seed=i, steps=steps) for i in range(count)]


def jobs(folder: Path, count: int, size: int, steps: int = STEPS) -> list[ExplorationJob]:
    all_plans = plans(folder, count, steps)
    return [ExplorationJob(tuple(all_plans[k : k + size])) for k in range(0, count, size)]


def slow(scene: ToyScene) -> ToySimulator:
    return ToySimulator(scene, delay=0.05)


RUNS = {
    "unguided": (JobRunner(slow, Wanderer), 1),
    "guided": (JobRunner(slow, guided_explorer, Perception(GuessingModel(), uncertainty=L1Residual())), 2),
}


@pytest.mark.parametrize("kind", RUNS)
def test_a_dataset_is_that_of_one_process_though_a_machine_dies_meanwhile(
    tmp_path: Path, cluster: Any, kind: str, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    run, size = RUNS[kind]
    run_here(run, jobs(tmp_path / "one", 3 * size, size), lambda frames: None)
    there = jobs(tmp_path / "there", 3 * size, size)
    (lost,) = [node for node in cluster.worker_nodes] or [cluster.add_node(num_cpus=1)]
    counted: list[int] = []

    def count(frames: int) -> None:
        counted.append(frames)
        at_work = [job for job in there if not job.finished and job.plans[0].paths.intrinsics.exists()]
        if len(at_work) == 2 and lost in cluster.worker_nodes:
            cluster.remove_node(lost, allow_graceful=False)

    RayExecutor(cluster.address)(run, there, count)
    assert lost not in cluster.worker_nodes
    assert "is done again" in caplog.text
    assert tree(tmp_path / "there") == tree(tmp_path / "one")
    assert sum(counted) == sum(job.frames for job in there)
    assert all(frames >= 0 for frames in counted)
    assert len(counted) > 2 * len(there)  # frames are counted as they come
    assert capfd.readouterr().err == ""
