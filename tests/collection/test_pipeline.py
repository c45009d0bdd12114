"""From a specification to a dataset: made once, whatever happens on the way."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from toy_world import (
    L1,
    SIMULATION,
    GuessingModel,
    ToyScene,
    ToySimulator,
    Wanderer,
    guided_explorer,
    specification,
    tree,
)

from deux.collection import viewpoints
from deux.collection.local_execution import LocalExecutor
from deux.collection.pipeline import build_dataset, read_manifest, write_lists
from deux.collection.specification import VIEWPOINTS, DatasetSpec
from deux.collection.verification import Rejection, Verdict, VerificationSettings
from deux.contracts import Robot, SceneArea
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.calibration import read_pose
from deux.registry import PluginChoice


def build(root: Path, spec: DatasetSpec | None = None) -> Path:
    return build_dataset(spec or specification(), root, ToySimulator, Wanderer)


def test_the_layout_is_that_of_the_void_release(tmp_path: Path) -> None:
    dataset = build(tmp_path)
    assert dataset == tmp_path / f"toy-{specification().key()}"
    kinds = ["image", "sparse_depth", "validity_map", "ground_truth", "absolute_pose"]
    for sequence in ("kitchen-00", "hall-00"):
        folder = dataset / "data" / sequence
        for kind in kinds:
            suffix = ".txt" if kind == "absolute_pose" else ".png"
            assert sorted(path.name for path in (folder / kind).iterdir()) == [f"{i:06d}{suffix}" for i in range(8)]
        assert (folder / "K.txt").exists()
    lists = {f"train_{kind}.txt" for kind in [*kinds, "intrinsics", "triplets", "triplets_baseline"]}
    assert {path.name for path in dataset.iterdir()} == lists | {"data", "manifest.json"}
    for kind in [*kinds, "intrinsics"]:  # each line leads to a file from the folder above, as in the release
        assert all((tmp_path / line).is_file() for line in (dataset / f"train_{kind}.txt").read_text().splitlines())


def test_the_manifest_counts(tmp_path: Path) -> None:
    spec = specification(verification=VerificationSettings(min_distance=0.1, min_angle=360.0), episodes=2)
    manifest = read_manifest(build(tmp_path, spec))
    assert manifest["frames"] == 2 * 2 * 8
    assert manifest["candidates"] == 2 * 2 * 6
    assert manifest["rejected"]["no_motion"] > 0
    assert manifest["triplets"] + sum(manifest["rejected"].values()) == manifest["candidates"]
    assert manifest["specification"] == json.loads(json.dumps(spec.description()))
    assert set(manifest["seconds"]) == {"exploration", "sparse depth", "verification", "preprocessing"}


def test_triplets_never_cross_episodes(tmp_path: Path) -> None:
    dataset = build(tmp_path, specification(episodes=3))
    lines = (dataset / "train_triplets.txt").read_text().splitlines()
    assert len(lines) == 2 * 3 * 6
    for line in lines:
        frames = [Path(image) for image in line.split("\t")]
        assert len({frame.parents[1] for frame in frames}) == 1
        target = int(frames[0].stem)
        assert [int(frame.stem) for frame in frames[1:]] == [target - 1, target - 2]


def test_a_finished_dataset_is_returned_at_once(tmp_path: Path) -> None:
    dataset = build(tmp_path)

    def never(*_: object) -> None:
        raise AssertionError("nothing is to be made")

    assert build_dataset(specification(), tmp_path, never, never) == dataset  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change",
    [
        {"name": "other"},
        {"scenes": (ToyScene("kitchen", "toy-1"),)},
        {"scenes": (ToyScene("kitchen", "toy-2"), ToyScene("hall", "toy-22"))},
        {"scenes": tuple(replace(scene, area=SceneArea(floor=1)) for scene in specification().scenes)},
        {"scenes": tuple(replace(scene, area=SceneArea(start=(0.5, 1.0))) for scene in specification().scenes)},
        {"explorer": "other"},
        {"explorer_settings": {"greed": 0.5}},
        {"simulation": replace(SIMULATION, camera=Camera(width=48, height=40, hfov=91.0))},
        {"simulation": replace(SIMULATION, robot=Robot(radius=0.11))},
        {"simulation": replace(SIMULATION, simulator=PluginChoice("simulators", "toy", {"delay": 1.0}))},
        {"steps": 9},
        {"episodes": 2},
        {"sparse": replace(specification().sparse, density=0.01)},
        {"verification": VerificationSettings(min_points=0.5)},
        {"seed": 4},
        {"model": "kbnet-0123"},
        {"uncertainty": L1},
        {"batch_size": 2},
        {"split": "test"},
    ],
    ids=lambda change: next(iter(change)),
)
def test_any_setting_changes_the_hash(change: dict[str, object]) -> None:
    assert specification(**change).folder_name != specification().folder_name
    assert specification(**change).key() == specification(**change).key()


def test_every_field_of_the_specification_is_in_its_hash() -> None:
    named = {"version", *DatasetSpec.__dataclass_fields__, "camera", "robot", "simulator"} - {"simulation"}
    assert set(specification(remembered_frames=30).description()) == named


def test_the_specification_describes_itself_in_json() -> None:
    description = specification(uncertainty=L1).description()
    assert json.loads(json.dumps(description)) == description
    assert (description["simulator"], description["uncertainty"]) == ({"name": "toy"}, {"name": "l1"})
    assert description["scenes"][1] == {
        "name": "hall",
        "identity": "toy-22",
        "area": {"floor": "largest", "region": None, "start": None},
    }


@pytest.mark.parametrize("explorer", ["toy", VIEWPOINTS])
def test_each_floor_has_its_episodes_where_all_are_asked_for(tmp_path: Path, explorer: str) -> None:
    kitchen, hall = specification().scenes
    area = SceneArea(floor="all", region=(-3.0, -2.0, 3.0, 2.0))
    dataset = build(tmp_path, specification(scenes=(replace(kitchen, area=area), hall), steps=6, explorer=explorer))
    names = sorted(path.name for path in (dataset / "data").iterdir())
    if explorer == "toy":
        assert names == ["hall-00", "kitchen-00", "kitchen-floor1-00"]
    else:
        assert len(names) == 3 * 6
    for name in names:
        pose = read_pose(dataset / "data" / name / "absolute_pose" / "000000.txt")
        assert pose[1, 3] == pytest.approx(1.25 + (3.0 if "floor1" in name else 0.0))
    written = read_manifest(dataset)["specification"]["scenes"][0]["area"]
    assert written == {"floor": "all", "region": [-3.0, -2.0, 3.0, 2.0], "start": None}


class CountingToy:
    """Makes simulators, and keeps the names of their scenes."""

    def __init__(self) -> None:
        self.made: list[str] = []
        self.closed: str | None = None

    def __call__(self, scene: ToyScene) -> ToySimulator:
        if scene.name == self.closed:
            raise DeuxError(f"{scene.name} is closed.")
        self.made.append(scene.name)
        return ToySimulator(scene)


@pytest.mark.parametrize("explorer", ["toy", VIEWPOINTS])
def test_a_scene_is_loaded_once_to_count_its_floors_however_often_a_build_goes_on(
    tmp_path: Path, explorer: str
) -> None:
    kitchen, hall = (replace(scene, area=SceneArea(floor="all")) for scene in specification().scenes)
    spec = specification(scenes=(kitchen, hall, ToyScene("attic")), steps=6, explorer=explorer)
    make = CountingToy()
    make.closed = "hall"
    with pytest.raises(DeuxError, match="hall is closed"):
        build_dataset(spec, tmp_path, make, Wanderer)
    assert make.made == ["kitchen"]
    make.closed = "attic"  # is not asked for all of its floors, and so not loaded until it is explored
    with pytest.raises(DeuxError, match="attic is closed"):
        build_dataset(spec, tmp_path, make, Wanderer)
    assert make.made == ["kitchen", "hall", "kitchen", "kitchen", "hall", "hall"]  # counted, then two floors of each
    again = CountingToy()
    dataset = build_dataset(spec, tmp_path, again, Wanderer)
    assert again.made == ["attic"]
    assert not (dataset / "floors").exists()
    at_once = build_dataset(spec, tmp_path / "at_once", CountingToy(), Wanderer)
    assert tree(at_once) == tree(dataset)


@pytest.mark.slow
def test_floors_are_counted_by_the_processes_that_collect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewpoints, "_FEW", 0)
    scenes = tuple(replace(scene, area=SceneArea(floor="all")) for scene in specification().scenes)
    spec = specification(scenes=scenes, steps=6, explorer=VIEWPOINTS)
    made = [
        build_dataset(spec, tmp_path / str(processes), ToySimulator, execute=LocalExecutor(processes))
        for processes in (1, 2)
    ]
    assert len(list((made[0] / "data").iterdir())) == 4 * 6
    assert tree(made[0]) == tree(made[1])


def test_starts_differ_between_scenes_episodes_and_seeds_but_not_between_explorers() -> None:
    spec = specification()
    kitchen, hall = spec.scenes
    seeds = [spec.episode_seed(kitchen, 0), spec.episode_seed(kitchen, 1), spec.episode_seed(hall, 0)]
    seeds.append(specification(seed=9).episode_seed(kitchen, 0))
    assert len(set(seeds)) == 4
    assert specification(explorer="other", model="m").episode_seed(kitchen, 0) == seeds[0]


def run_until(root: Path, lines: int) -> None:
    """Build in a process of its own and kill it after it has told that many steps."""
    code = f"import toy_world; toy_world.build_slowly({str(root)!r})"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment)
    assert process.stdout is not None
    with process:
        for _ in range(lines):
            assert process.stdout.readline(), "the process ended before it was killed"
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL


def test_a_killed_build_goes_on_where_it_was(tmp_path: Path) -> None:
    spec = specification(model="guess", uncertainty=L1)
    whole = build_dataset(spec, tmp_path / "whole", ToySimulator, guided_explorer, GuessingModel())
    written: dict[Path, int] = {}
    for lines in (3, 14):  # in the middle of the exploration, and of the sparse depth
        run_until(tmp_path / "cut", lines)
        partial = next((tmp_path / "cut").glob(".*.partial"))
        assert {path: path.stat().st_mtime_ns for path in written} == written
        for pose in partial.glob("data/*/absolute_pose/[0-9]*.txt"):
            for kind in ("absolute_pose", "image", "ground_truth", "labels"):
                file = next((pose.parents[1] / kind).glob(f"{pose.stem}.*"))
                written[file] = file.stat().st_mtime_ns
    assert not (tmp_path / "cut" / spec.folder_name).exists()
    made: list[ToySimulator] = []

    def make_simulator(scene: ToyScene) -> ToySimulator:
        made.append(ToySimulator(scene))
        return made[-1]

    cut = build_dataset(spec, tmp_path / "cut", make_simulator, guided_explorer, GuessingModel())
    assert tree(cut) == tree(whole)
    assert sum(simulator.rendered for simulator in made) <= 16 - len(written) // 4
    moved = {cut / file.relative_to(partial): time for file, time in written.items()}
    assert {path: path.stat().st_mtime_ns for path in moved} == moved
    assert len(moved) >= 4


def resume(root: Path, spec: DatasetSpec, calls: Counter[str]) -> int:
    """Calls of the file system by which a build goes on that was killed just before it wrote the manifest."""
    dataset = build(root, spec)
    before = tree(dataset)
    os.replace(dataset, root / f".{dataset.name}.partial")
    (root / f".{dataset.name}.partial" / "manifest.json").unlink()
    calls.clear()
    build(root, spec)
    made = calls.total()
    assert tree(dataset) == before
    return made


def test_resuming_looks_at_folders_and_not_at_frames(tmp_path: Path, file_system_calls: Counter[str]) -> None:
    scene = (ToyScene(),)
    few = resume(tmp_path / "few", specification(scenes=scene, episodes=4), file_system_calls)
    longer = resume(tmp_path / "longer", specification(scenes=scene, episodes=4, steps=24), file_system_calls)
    more = resume(tmp_path / "more", specification(scenes=scene, episodes=12), file_system_calls)
    assert longer == few
    assert (more - few) / 8 <= 15  # for each further sequence


@pytest.mark.slow
def test_a_hundred_thousand_frames_resume_in_ten_seconds_and_open_in_one(tmp_path: Path) -> None:
    def spec(episodes: int) -> DatasetSpec:
        return specification(scenes=(ToyScene(),), episodes=episodes, steps=102)

    thousand = spec(1000)
    original = build(tmp_path / "one", spec(1)) / "data" / "room-00"
    partial = tmp_path / f".{thousand.folder_name}.partial"
    for episode in range(1000):
        shutil.copytree(original, partial / "data" / f"room-{episode:02d}", copy_function=os.link)
    start = time.process_time()
    dataset = build(tmp_path, thousand)
    assert time.process_time() - start < 10
    start = time.process_time()
    assert len(DatasetReader(dataset).triplets("train", (-1, -2))) > 90_000
    assert time.process_time() - start < 1


def test_two_builders_of_one_dataset_make_it_once(tmp_path: Path) -> None:
    made: list[ToySimulator] = []

    def make_simulator(scene: ToyScene) -> ToySimulator:
        made.append(ToySimulator(scene, delay=0.005))
        return made[-1]

    def work() -> None:
        build_dataset(specification(), tmp_path, make_simulator, Wanderer)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == len(specification().scenes)


def test_a_full_disk_is_one_sentence_and_the_build_can_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, left = Path.write_bytes, [20]

    def limited(path: Path, content: bytes) -> int:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, content)

    monkeypatch.setattr(Path, "write_bytes", limited)
    with pytest.raises(DeuxError, match="The disk is full"):
        build(tmp_path / "full")
    assert not [path for path in (tmp_path / "full").iterdir() if not path.name.startswith(".")]
    left[0] = 10**6
    assert tree(build(tmp_path / "full")) == tree(build(tmp_path / "roomy"))


def test_a_dataset_without_a_usable_frame_is_an_error(tmp_path: Path) -> None:
    spec = specification(verification=VerificationSettings(min_distance=100.0, min_angle=400.0))
    with pytest.raises(DeuxError, match=r"no frame that passes verification \(12 no motion\)"):
        build(tmp_path, spec)
    assert not (tmp_path / spec.folder_name).exists()


def test_two_scenes_of_one_name_are_an_error(tmp_path: Path) -> None:
    spec = specification(scenes=(ToyScene("a", "1"), ToyScene("a", "2")))
    with pytest.raises(DeuxError, match=r"Two scenes of dataset toy, .* are named a:"):
        build(tmp_path, spec)


@pytest.mark.parametrize("explorer", [VIEWPOINTS, "wanderer"])
def test_a_scene_that_is_named_as_another_ones_floor_is_an_error(tmp_path: Path, explorer: str) -> None:
    scenes = (ToyScene("a", "1", area=SceneArea("all")), ToyScene("a-floor1", "2"))
    with pytest.raises(DeuxError, match=r"a floor of another, are named a-floor1:"):
        build(tmp_path, specification(scenes=scenes, explorer=explorer))


def test_viewpoints_become_a_test_split_of_one_triplet_each(tmp_path: Path) -> None:
    spec = specification(explorer=VIEWPOINTS, steps=5, split="test")
    dataset = build_dataset(spec, tmp_path, ToySimulator)
    lists = [(dataset / f"test_{kind}.txt").read_text().splitlines() for kind in ("triplets", "triplets_baseline")]
    assert [[set(line.split("\t")) for line in lines] for lines in lists[:1]] == [
        [set(line.split("\t")) for line in lines] for lines in lists[1:]
    ]
    assert len(lists[0]) == 10
    assert read_manifest(dataset)["candidates"] == 10
    assert build_dataset(replace(spec, explorer="wanderer", steps=8), tmp_path, ToySimulator, Wanderer) != dataset


def test_a_folder_without_manifest_is_no_dataset_of_ours(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"holds no readable manifest\.json"):
        read_manifest(tmp_path)


def test_lists_name_the_accepted_frames_in_one_order(tmp_path: Path) -> None:
    frames = [f"{number:06d}" for number in range(8)]
    recent = {t: Verdict((f1, f2), None, True) for f2, f1, t in zip(frames, frames[1:], frames[2:], strict=False)}
    recent["000004"] = recent["000004"]._replace(rejection=Rejection.TOO_FEW_POINTS)
    baseline = {"000000": Verdict(("000003", "000005"), None, True), "000003": Verdict((), Rejection.NO_MOTION, False)}
    write_lists(tmp_path, "toy-123", "train", {"room": {"recent": recent, "baseline": baseline}})
    lines = {path.stem.removeprefix("train_"): path.read_text().splitlines() for path in tmp_path.glob("*.txt")}
    accepted = ["000002", "000003", "000005", "000006", "000007"]
    assert lines["image"] == [f"toy-123/data/room/image/{name}.png" for name in accepted]
    assert lines["absolute_pose"] == [f"toy-123/data/room/absolute_pose/{name}.txt" for name in accepted]
    assert lines["intrinsics"] == ["toy-123/data/room/K.txt"] * 5
    assert set(lines) == {
        *("image", "sparse_depth", "validity_map", "ground_truth", "absolute_pose", "intrinsics"),
        *("triplets", "triplets_baseline"),
    }
    assert lines["triplets"][2].split("\t") == [f"toy-123/data/room/image/00000{i}.png" for i in (5, 4, 3)]
    assert [line.split("\t") for line in lines["triplets_baseline"]] == [
        [f"toy-123/data/room/image/00000{i}.png" for i in (0, 3, 5)]
    ]
