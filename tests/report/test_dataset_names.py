import pytest

from deux.errors import DeuxError
from deux.report.comparable_runs import group_comparable
from deux.report.dataset_names import DatasetNames
from deux.report.runs import find_runs


def test_datasets_are_called_by_their_source_and_by_what_differs(write_run, outputs, here, there):
    low = {**here, "robot": {"camera_height": 0.4}}
    for explorer in ("random", "deux"):
        write_run(explorer, "kbnet", 0, 10.0)
    write_run("deux", "kbnet", 0, 10.0, place=there, folder="there")
    write_run("deux", "kbnet", 0, 10.0, place=low, folder="low")
    groups = group_comparable(find_runs(outputs), [])
    datasets = DatasetNames(groups)
    assert {datasets.name(group.testing) for group in groups} == {
        "apartments",
        "apartments (robot.camera_height=0.4)",
        "files hall",
    }
    assert datasets.name(datasets.first) == "apartments"  # most explorers
    chosen = DatasetNames(groups, "files hall")
    assert chosen.name(chosen.first) == "files hall"
    with pytest.raises(DeuxError, match=r"report\.first=halls is not a dataset of these runs: did you mean files hall"):
        DatasetNames(groups, "halls")


def test_recorded_data_are_called_by_their_folder(write_run, outputs, here):
    recorded = {**here, "evaluation": {"data": "/data/void_release"}}
    write_run("deux", "kbnet", 0, 10.0, place=recorded, trained_in=here)
    (runs,) = group_comparable(find_runs(outputs), [])
    datasets = DatasetNames([runs])
    assert datasets.name(runs.testing) == "void_release"
    assert datasets.name(runs.own_testing) == "apartments"


@pytest.mark.parametrize(
    ("scenes", "name"),
    [
        (5, "apartments"),
        ([11, 12], "apartments"),
        ("x/hall.ply", "apartments hall"),
        (["a", "b", "c", "d"], "apartments a, b, c, d"),
        (["a", "b", "c", "d", "e"], "apartments 5 scenes"),
    ],
)
def test_chosen_test_scenes_are_named_while_they_are_few(write_run, outputs, here, scenes, name):
    write_run("deux", "kbnet", 0, 10.0, place={**here, "scenes": {**here["scenes"], "test": scenes}})
    groups = group_comparable(find_runs(outputs), [])
    assert DatasetNames(groups).name(groups[0].testing) == name
