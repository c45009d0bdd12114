"""Jobs as a process of a cluster runs them: what is handed over, in which order, and what must agree."""

from pathlib import Path

import pytest
from toy_world import GuessingModel, ToyScene, guided_explorer, slow_simulator, tree

from deux.collection import job_worker
from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import EpisodeRunner
from deux.collection.job_worker import JobWorker, package_versions
from deux.collection.jobs import Job
from deux.collection.perception import Perception
from deux.errors import DeuxError
from deux.plugin_kinds import Plugin
from deux.registry import Registry
from deux_plugins.uncertainties.photometric import L1Residual

RUN = EpisodeRunner(slow_simulator, guided_explorer, Perception(GuessingModel(), uncertainty=L1Residual()))


def job(folder: Path, steps: int = 12) -> Job[EpisodePlan]:
    return Job(
        tuple(EpisodePlan(folder / f"room-{i}", ToyScene(f"room{i}", "x" * i), seed=i, steps=steps) for i in range(2))
    )


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch) -> JobWorker:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")  # a worker without a card sets it, for good
    made = JobWorker()
    made.load(RUN)
    return made


@pytest.mark.parametrize("part_bytes", [1, 2**30], ids=["many parts", "few parts"])
def test_files_come_whole_and_in_an_order_in_which_a_break_does_no_harm(
    tmp_path: Path, worker: JobWorker, monkeypatch: pytest.MonkeyPatch, part_bytes: int
) -> None:
    monkeypatch.setattr(job_worker, "_PART_BYTES", part_bytes)
    monkeypatch.setattr(job_worker, "_SECONDS", 0.05)
    RUN(job(tmp_path / "one"), lambda frames: None)
    there = job(tmp_path / "there")
    done = 0
    for part in worker.run(there, streamed=True):
        done += part.done
        for plan, name, content in part.files:
            path = there.plans[plan].folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            if path.parent.name == "absolute_pose":
                assert {file.parent.name for file in path.parents[1].rglob(f"{path.stem}.png")} == {
                    "image",
                    "ground_truth",
                    "labels",
                }
            if name == "episode.json":
                written = {key for key in tree(tmp_path / "there") if key.startswith(f"room-{plan}/")}
                assert written == {key for key in tree(tmp_path / "one") if key.startswith(f"room-{plan}/")}
    assert done == there.size
    assert tree(tmp_path / "there") == tree(tmp_path / "one")


def test_nothing_is_left_in_the_temporary_folder(
    tmp_path: Path, worker: JobWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    assert sum(part.done for part in worker.run(job(tmp_path / "there", steps=4), streamed=True)) == 8
    assert list(scratch.iterdir()) == []
    assert not (tmp_path / "there").exists()


def test_frames_in_place_are_counted_and_not_sent(tmp_path: Path, worker: JobWorker) -> None:
    RUN(job(tmp_path / "one", steps=4), lambda frames: None)
    parts = list(worker.run(job(tmp_path / "there", steps=4), streamed=False))
    assert sum(part.done for part in parts) == 8
    assert not any(part.files for part in parts)
    assert tree(tmp_path / "there") == tree(tmp_path / "one")


def test_other_versions_are_refused(worker: JobWorker) -> None:
    here = package_versions()
    assert worker.check(here)
    with pytest.raises(DeuxError, match=rf"has torch {here['torch']}, but .* has torch 1\.0: install the same"):
        worker.check({**here, "torch": "1.0"})


def test_packages_of_plugins_are_compared_where_both_have_them(
    worker: JobWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def install(version: str) -> None:
        plugin = Plugin("other", "rewards", "deux-other", version, "other:Other", lambda: None)
        monkeypatch.setattr(Registry, "plugins", lambda registry, kind: [plugin] if kind == "rewards" else [])

    install("1.0")
    expected = package_versions()
    install("1.1")
    with pytest.raises(DeuxError, match=r"has deux-other 1\.1, but .* has deux-other 1\.0: install the same"):
        worker.check(expected)
    monkeypatch.undo()
    assert worker.check(expected)
