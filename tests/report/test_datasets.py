import pytest

from deux.errors import DeuxError
from deux.report.comparison import comparisons
from deux.report.datasets import Datasets
from deux.report.runs import find_runs


def test_datasets_are_called_by_their_source_and_by_what_differs(write_run, outputs, here, there):
    low = {**here, "robot": {"camera_height": 0.4}}
    for explorer in ("random", "deux"):
        write_run(explorer, "kbnet", 0, 10.0)
    write_run("deux", "kbnet", 0, 10.0, place=there, folder="there")
    write_run("deux", "kbnet", 0, 10.0, place=low, folder="low")
    compared = comparisons(find_runs(outputs), [])
    datasets = Datasets(compared)
    assert {datasets.name(comparison.testing) for comparison in compared} == {
        "apartments",
        "apartments (robot.camera_height=0.4)",
        "files hall",
    }
    assert datasets.name(datasets.first) == "apartments"  # most explorers
    chosen = Datasets(compared, "files hall")
    assert chosen.name(chosen.first) == "files hall"
    with pytest.raises(DeuxError, match=r"report\.first=halls is no dataset of these runs: did you mean files hall\?"):
        Datasets(compared, "halls")


def test_recorded_data_are_called_by_their_folder(write_run, outputs, here):
    recorded = {**here, "evaluation": {"data": "/data/void_release"}}
    write_run("deux", "kbnet", 0, 10.0, place=recorded, trained_in=here)
    (comparison,) = comparisons(find_runs(outputs), [])
    datasets = Datasets([comparison])
    assert datasets.name(comparison.testing) == "void_release"
    assert datasets.name(comparison.own_testing) == "apartments"
