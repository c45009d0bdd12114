"""The command `python -m deux.doctor`."""

import json
import re

import pytest
import trimesh
from void_layout import dataset, enlarge

from deux.configuration import compose
from deux.contracts import SceneFiles, SceneSource, SceneSplits
from deux.doctor.__main__ import main
from deux.doctor.checkup import Checkup
from deux.doctor.installation_checks import check_simulators
from deux.doctor.scene_checks import check_scenes
from deux.registry import registry
from deux.simulator.renderers import RENDERERS


@pytest.fixture
def room(tmp_path):
    """A file with an empty room of 4 x 3 x 5 m."""
    path = tmp_path / "room.ply"
    trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, 5]]).export(path)
    return path


def lines(capsys) -> dict[str, str]:
    """The facts that were printed, by name."""
    rows = (line.strip().split("  ", 1) for line in capsys.readouterr().out.splitlines())
    return {row[0]: row[1].strip() for row in rows if len(row) == 2}


def test_all_is_well_for_the_defaults(capsys):
    assert main([]) == 0
    facts = lines(capsys)
    assert facts["torch"].startswith("2.")
    assert facts["renderer embree"] == "works"
    assert "deux" in facts["explorers"]
    assert facts["explore"] == "deux"
    assert facts["train"].split() == ["4", "4", "0.00", "4"]


def test_the_first_scene_is_described_if_asked_for(room, capsys):
    assert main(["scenes=files", f"scenes.train={room}", "--load"]) == 0
    facts = lines(capsys)
    assert facts["triangles"] == "12"
    assert facts["extent"].startswith("4.0 x 3.0 x 5.0 m")
    assert facts["labels"].startswith("none")
    height, level, free = (float(number) for number in re.findall(r"(-?[\d.]+) m", facts["floor"]))
    assert height == 0.0
    assert level == pytest.approx(20.0, rel=0.02)
    assert free == pytest.approx(3.8 * 4.8, rel=0.05), "the robot's radius is taken off at each wall"


def test_switches_and_options_may_be_in_any_order(room, capsys):
    assert main(["scenes=files", "--load", f"scenes.train={room}", "robot.radius=0.2"]) == 0
    assert "room for the robot on 16.6 m2" in lines(capsys)["floor"]


def test_a_mistake_is_one_sentence_without_a_stack_trace(capsys):
    assert main(["scenes=fils"]) == 1
    assert capsys.readouterr().err == (
        "deux: there is no source of scenes called 'fils': did you mean files? There is: "
        f"{', '.join(sorted({*registry().names('scenes'), 'low_camera'}))}.\n"
    )


def test_the_same_as_json(capsys):
    assert main(["--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["faults"] == 0
    facts = {name: value for section in report["sections"] for name, value in section["facts"]}
    assert facts["renderer embree"] == "works"
    assert facts["simulators"].startswith("habitat, mesh")
    assert main(["--json", "scenes=fils"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["faults"] == 1
    assert "did you mean files?" in report["sections"][-1]["faults"][0]


def test_an_option_that_its_plugin_does_not_have_is_a_fault(capsys):
    assert main(["explore=frontier", "explore.distanse=1"]) == 1
    assert "explore.distanse is not an option of FrontierExplorer" in lines(capsys)["FAULT"]


def test_what_is_missing_is_reported_and_counted(tmp_path, capsys):
    assert main(["scenes=files", f"scenes.train={tmp_path / 'nowhere.ply'}"]) == 1
    assert "there is no scene file" in lines(capsys)["FAULT"]


def test_frames_are_read_as_configured(tmp_path, capsys):
    assert main([f"training_data={tmp_path}"]) == 1
    assert str(tmp_path) in lines(capsys)["FAULT"]


def test_frames_are_judged_by_the_camera_and_drawn_below_the_option_that_names_them(tmp_path, capsys):
    folders = [dataset(tmp_path / "train", triplets=False), dataset(tmp_path / "test", "test", triplets=False)]
    for folder in folders:
        enlarge(folder)
    given = [f"training_data={folders[0]}", f"evaluation.data={folders[1]}", f"paths.outputs={tmp_path / 'outputs'}"]
    assert main([*given, "camera.max_depth=100"]) == 0
    said = capsys.readouterr().out
    for preview in ("training_data/train.png", "evaluation.data/test.png"):
        assert (tmp_path / "outputs/doctor" / preview).is_file()
        assert str(tmp_path / "outputs/doctor" / preview) in said
    assert main([*given, "camera.max_depth=10"]) == 1
    assert "max_depth=10 too small?" in capsys.readouterr().out


def test_an_option_needs_the_split_that_its_task_reads(tmp_path, capsys):
    folders = [dataset(tmp_path / "train", triplets=False), dataset(tmp_path / "test", "test", triplets=False)]
    outputs = f"paths.outputs={tmp_path / 'outputs'}"
    assert main([f"training_data={folders[0]}", f"evaluation.data={folders[1]}", outputs]) == 0
    capsys.readouterr()
    assert main([f"training_data={folders[1]}", outputs]) == 1
    assert f"training_data needs train frames: {folders[1]} has no train split" in lines(capsys)["FAULT"]
    assert main([f"evaluation.data={folders[0]}", outputs]) == 1
    assert f"evaluation.data needs test frames: {folders[0]} has no test split" in lines(capsys)["FAULT"]


class Downloads(SceneSource):
    """Two scenes, of which one is there."""

    def __init__(self, folder: str, train: int = 2, validation: int = 0, test: int = 0) -> None:
        pass

    def splits(self) -> SceneSplits:
        return SceneSplits((), (), ())

    def inventory(self) -> dict[str, tuple[SceneFiles, ...]]:
        scenes = [SceneFiles("there", (), without=("labels",))]
        scenes += [SceneFiles(f"scene_{k}", missing=(f"no scene_{k}.glb",)) for k in range(5)]
        return {"train": tuple(scenes), "validation": (), "test": ()}


def test_the_inventory_of_a_source_is_printed(capsys):
    registry().register("scenes", "downloads", Downloads)
    try:
        cfg = compose(["scenes=downloads", "+scenes.folder=x", "scenes.train=1"])
        checkup = Checkup()
        check_scenes(checkup, cfg, load=True)
    finally:
        registry().unregister("scenes", "downloads")
    printed = capsys.readouterr().out
    assert "train missing        scene_0: no scene_0.glb" in printed
    assert "train missing        and 2 more" in printed
    assert "train without        there: labels" in printed
    assert checkup.faults == 1, "there is no scene to load"


def test_a_renderer_that_fails_is_a_fault_only_if_it_is_chosen(monkeypatch, capsys):
    for broken, faults in (("pyrender", 0), ("embree", 1)):
        monkeypatch.setitem(RENDERERS, broken, "deux.nowhere:Renderer")
        checkup = Checkup()
        check_simulators(checkup, compose(["simulator.renderer=embree"]))
        assert checkup.faults == faults, broken
    facts = lines(capsys)
    assert "No module named 'deux.nowhere'" in facts["FAULT"]
    assert facts["renderer pyrender"].startswith("does not work")
