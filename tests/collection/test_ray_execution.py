"""Jobs on a Ray cluster: two machines, each a raylet of its own, of which one is killed now and then."""

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from mesh_world import Deadly, Mistaken, mesh_room, signed_room, slow_toy, write_room
from toy_world import (
    GuessingModel,
    ToyScene,
    ToySimulator,
    Wanderer,
    convolving_predictor,
    guided_explorer,
    tree,
)

from deux.collection import viewpoints
from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import EpisodeRunner
from deux.collection.jobs import Job, JobRunner, run_here, share_out
from deux.collection.perception import Perception
from deux.collection.viewpoints import collect_viewpoints, plan_viewpoints
from deux.contracts import SceneReference
from deux.errors import DeuxError
from deux_plugins.uncertainties.photometric import L1Residual

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install -e '.[ray]'")

from ray.cluster_utils import Cluster  # noqa: E402

from deux.collection import ray_execution  # noqa: E402
from deux.collection.ray_execution import RayExecutor  # noqa: E402

# Ray 2.45 leaves /dev/null open.
pytestmark = [pytest.mark.timeout(240), pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")]
STEPS = 24
KEPT: list[Any] = []
"""Machines of a cluster in this process, which Ray's exit handlers hold too.

From Python 3.14 on, a forked process drops those handlers first of all. Were they the last to hold a machine, a process
that loads frames in a later test would wait there for a thread of Ray's that was not forked.
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two machines with room for one worker each."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(Path(__file__).parent)  # where workers find what the tests are made of
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        KEPT.extend([made.head_node, made.add_node(num_cpus=1)])
        yield made
    finally:
        made.shutdown()
        os.environ.pop("PYTHONPATH")
        if before is not None:
            os.environ["PYTHONPATH"] = before


def make_jobs(
    folder: Path, scenes: Sequence[SceneReference], size: int = 1, steps: int = STEPS
) -> list[Job[EpisodePlan]]:
    plans = [EpisodePlan(folder / f"room-{i}", scene, seed=i, steps=steps) for i, scene in enumerate(scenes)]
    return [Job(tuple(plans[k : k + size])) for k in range(0, len(plans), size)]


def toy_scenes(count: int) -> list[SceneReference]:
    return [ToyScene(f"room{i}", "x" * i) for i in range(count)]


class KillsAMachine:
    """Counts frames; kills the cluster's second machine as soon as two workers are in the middle of a job."""

    def __init__(self, cluster: Any, jobs: Sequence[Job[EpisodePlan]]) -> None:
        self.counted: list[int] = []
        self.killed = False
        self._cluster, self._jobs = cluster, jobs
        (self._machine,) = list(cluster.worker_nodes) or [cluster.add_node(num_cpus=1)]

    def __call__(self, frames: int) -> None:
        self.counted.append(frames)
        at_work = [job for job in self._jobs if not job.finished and job.plans[0].paths.intrinsics.exists()]
        if len(at_work) == 2 and not self.killed:
            self._cluster.remove_node(self._machine, allow_graceful=False)
            self.killed = True


def assert_that_of_one_process(
    run: JobRunner[EpisodePlan],
    jobs_in: Callable[[Path], list[Job[EpisodePlan]]],
    folder: Path,
    cluster: Any,
    results: str,
) -> None:
    run_here(run, jobs_in(folder / "one"), lambda frames: None)
    jobs = jobs_in(folder / "there")
    count = KillsAMachine(cluster, jobs)
    RayExecutor(cluster.address, results=results)(run, jobs, count)
    assert count.killed
    assert tree(folder / "there") == tree(folder / "one")
    assert sum(count.counted) == sum(job.size for job in jobs)
    assert min(count.counted) >= 0
    assert len(count.counted) > 2 * len(jobs)  # frames are counted as they come


def test_a_dataset_is_that_of_one_process_though_a_machine_dies_meanwhile(
    tmp_path: Path, cluster: Any, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    def jobs_in(folder: Path) -> list[Job[EpisodePlan]]:
        return make_jobs(folder, toy_scenes(4))

    assert_that_of_one_process(EpisodeRunner(slow_toy, Wanderer), jobs_in, tmp_path, cluster, "streamed")
    assert "is run again" in caplog.text
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_so_is_one_that_a_model_guides(tmp_path: Path, cluster: Any) -> None:
    def jobs_in(folder: Path) -> list[Job[EpisodePlan]]:
        return make_jobs(folder, toy_scenes(6), size=2)

    run = EpisodeRunner(slow_toy, guided_explorer, Perception(GuessingModel(), uncertainty=L1Residual()))
    assert_that_of_one_process(run, jobs_in, tmp_path, cluster, "shared")


@pytest.mark.slow
def test_scenes_in_files_are_loaded_once_where_the_files_are(tmp_path: Path, cluster: Any) -> None:
    scenes = [write_room(tmp_path, name, seed) for seed, name in enumerate(("kitchen", "hall"))]
    run = EpisodeRunner(mesh_room, Wanderer)
    run_here(run, make_jobs(tmp_path / "one", [*scenes, *scenes], steps=4), lambda frames: None)
    (tmp_path / "loads.txt").unlink()
    RayExecutor(cluster.address)(run, make_jobs(tmp_path / "there", [*scenes, *scenes], steps=4), lambda frames: None)
    assert tree(tmp_path / "there") == tree(tmp_path / "one")
    loads = [line.split() for line in (tmp_path / "loads.txt").read_text().splitlines()]
    assert sorted(name for name, _ in loads) == ["hall", "kitchen"]
    assert len({process for _, process in loads}) == 1  # of the process that is there for it
    missing = replace(scenes[0], path=tmp_path / "gone.obj")
    with pytest.raises(DeuxError, match=r"^there is no scene file .*/gone\.obj\.$"):
        RayExecutor(cluster.address)(run, make_jobs(tmp_path / "none", [missing]), lambda frames: None)


def test_a_killed_run_goes_on_and_keeps_the_episodes_that_were_finished(tmp_path: Path, cluster: Any) -> None:
    run = EpisodeRunner(ToySimulator, guided_explorer, Perception(GuessingModel(), uncertainty=L1Residual()))
    run_here(run, make_jobs(tmp_path / "one", toy_scenes(2), size=2, steps=6), lambda frames: None)
    shutil.copytree(tmp_path / "one", tmp_path / "there")
    (tmp_path / "there/room-1/episode.json").unlink()  # as if it had been killed there: room-0 is finished
    (tmp_path / "there/room-1/absolute_pose/000005.txt").unlink()
    (tmp_path / "there/room-1/image/000009.png").write_bytes(b"of a longer walk")
    finished = {path: path.stat().st_mtime_ns for path in (tmp_path / "there/room-0").rglob("*.*")}
    jobs = make_jobs(tmp_path / "there", toy_scenes(2), size=2, steps=6)
    RayExecutor(cluster.address, workers=1)(run, jobs, lambda frames: None)
    assert tree(tmp_path / "there") == tree(tmp_path / "one")
    assert {path: path.stat().st_mtime_ns for path in finished} == finished


@pytest.mark.slow
def test_viewpoints_and_robots_of_one_batch_are_shared_out_and_sent_back(
    tmp_path: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared: list[list[Job[Any]]] = []

    def share(*given: Any) -> list[Job[Any]]:
        shared.append(share_out(*given))
        return shared[-1]

    monkeypatch.setattr(ray_execution, "share_out", share)
    monkeypatch.setattr(viewpoints, "_FEW", 0)
    execute = RayExecutor(cluster.address, workers=2)
    for folder, executor in {"one": run_here, "there": execute}.items():
        floors = [plan_viewpoints(tmp_path / folder, scene, 0, 4) for scene in toy_scenes(1)]
        collect_viewpoints(floors, partial(signed_room, tmp_path / "rooms"), executor)
        jobs = [replace(job, divisible=True) for job in make_jobs(tmp_path / folder, toy_scenes(4), size=4, steps=6)]
        run = EpisodeRunner(
            partial(signed_room, tmp_path / "rooms"),
            guided_explorer,
            Perception(convolving_predictor(), uncertainty=L1Residual()),
        )
        executor(run, jobs, lambda frames: None)
    assert tree(tmp_path / "there") == tree(tmp_path / "one")
    rooms = [path.name.split(" ") for path in (tmp_path / "rooms").iterdir()]
    here = str(os.getpid())
    assert {name for name, process in rooms if process != here} == {f"room{i}" for i in range(4)}
    assert [[len(job.plans) for job in jobs] for jobs in shared] == [[2, 2], [2, 2]]


def test_a_mistake_that_a_worker_finds_is_reported_in_its_own_sentence(tmp_path: Path, cluster: Any) -> None:
    with pytest.raises(DeuxError, match=r"^the robot has no battery: charge it\.$"):
        RayExecutor(cluster.address, workers=1)(
            EpisodeRunner(ToySimulator, Mistaken), make_jobs(tmp_path, toy_scenes(2)), lambda frames: None
        )
    assert not ray.is_initialized()


def test_a_job_that_ends_its_worker_again_and_again_is_given_up(tmp_path: Path, cluster: Any) -> None:
    with pytest.raises(DeuxError, match=r"^2 workers died running room-0, the last one on .* memory ran out"):
        RayExecutor(cluster.address, workers=1, attempts=2)(
            EpisodeRunner(ToySimulator, Deadly), make_jobs(tmp_path, toy_scenes(1)), lambda frames: None
        )


def test_no_room_and_no_cluster_are_reported(tmp_path: Path, cluster: Any) -> None:
    run, jobs = EpisodeRunner(ToySimulator, Wanderer), make_jobs(tmp_path, toy_scenes(1))
    with pytest.raises(DeuxError, match="no machine with 64 CPUs and 0 graphics cards"):
        RayExecutor(cluster.address, cpus=64)(run, jobs, lambda frames: None)
    with pytest.raises(DeuxError, match=r"no machine with 1 CPUs and 0\.5 graphics cards"):
        RayExecutor(cluster.address, gpus=0.5)(run, jobs, lambda frames: None)
    with pytest.raises(DeuxError, match=r"address is '127\.0\.0\.1:9', but no Ray cluster answers there"):
        RayExecutor("127.0.0.1:9")(run, jobs, lambda frames: None)
    with pytest.raises(DeuxError, match=r"address is 'ray://head:10001': it must be null, auto or the host:port"):
        RayExecutor("ray://head:10001")
