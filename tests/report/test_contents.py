import json

import pytest

from deux.errors import DeuxError
from deux.report.contents import read_contents


def test_runs_become_the_papers_three_tables(write_run, outputs, names, here, there):
    for seed in range(2):
        for explorer in ("random", "frontier", "deux"):
            write_run(explorer, "kbnet", seed, 20.0, folder="one")
            write_run(explorer, "kbnet", seed, 30.0, place=there, trained_in=here, folder="three")
        for explorer in ("random", "deux"):
            write_run(explorer, "kbnet", seed, 25.0, place=there, folder="two")
    contents = read_contents(outputs, names, starred=["deux"])
    assert [section.title for section in contents.sections] == [
        "Table I: Depth completion on the apartments test set",
        "Table II: Depth completion on the files hall test set",
        "Table III: Zero-shot transfer: trained on apartments, tested on files hall",
    ]
    assert [section.table.name for section in contents.sections] == ["table1", "table2", "table3"]
    rows = [row.labels[1] for row in contents.sections[1].table.parts[1]]
    assert rows == ["Random", "DEUX", "DEUX*"]
    assert (contents.finished, contents.missing) == (16, 0)
    swapped = read_contents(outputs, names, first="files hall")
    assert [section.title.partition(" set")[0] for section in swapped.sections[:2]] == [
        "Table I: Depth completion on the files hall test",
        "Table II: Depth completion on the apartments test",
    ]


@pytest.mark.parametrize("transferred", [True, False])
def test_the_first_of_two_datasets_with_as_many_explorers(write_run, outputs, names, here, transferred):
    """Table I narrowed to the explorers of Table II; sorted by their options, the other dataset would come first."""
    other = {**here, "camera": {"width": 64, "height": 64, "hfov": 70.0}, "robot": {"camera_height": 0.4}}
    own = {**here, "camera": {"width": 64, "height": 64, "hfov": 90.0}}
    for explorer in ("random", "deux"):
        write_run(explorer, "kbnet", 0, 20.0, place=own, folder="one")
        write_run(explorer, "kbnet", 0, 25.0, place=other, folder="two")
        if transferred:
            write_run(explorer, "kbnet", 1, 25.0, place=other, folder="two")
            write_run(explorer, "kbnet", 0, 30.0, place=other, trained_in=own, folder="three")
    sections = read_contents(outputs, names, starred=["deux"]).sections
    low = "apartments (camera.hfov=70, robot.camera_height=0.4)"
    assert [section.title for section in sections] == [
        "Table I: Depth completion on the apartments test set",
        f"Table II: Depth completion on the {low} test set",
        f"Table III: Zero-shot transfer: trained on apartments, tested on {low}",
    ][: len(sections)]
    rows = [row.labels[1] for row in sections[1].table.parts[1]]
    assert rows == ["Random", "DEUX", *(["DEUX*"] if transferred else [])]


def test_other_budgets_get_tables_of_their_own(write_run, outputs, names):
    for explorer in ("random", "deux"):
        write_run(explorer, "kbnet", 0, 20.0)
    write_run("deux", "kbnet", 0, 20.0, folder="long", training__steps=900, collect__steps=150)
    first, second = read_contents(outputs, names).sections
    assert second.title == f"{first.title}, with collect.steps=150, training.steps=900"
    assert (first.table.name, second.table.name) == ("table1", "table1_2")


def test_missing_runs_and_commands_are_listed(write_run, write_sweep, outputs, names):
    write_sweep(["explore=deux,random", "model=kbnet,voiced", "seed=0,1,2"])
    write_run("random", "kbnet", 0, 20.0)
    write_run("deux", "kbnet", 2, None)
    write_run("frontier", "kbnet", 0, 20.0, folder="alone", overrides=("explore=frontier", "scenes.test=[1, 2]"))
    write_sweep(["explore=novelty", "seed=5,6"], folder="never")
    contents = read_contents(outputs, names)
    (section,) = contents.sections
    assert "Random, VOICED: seeds 0, 1, 2" in section.missing
    assert "DEUX, KBNet: seeds 0, 1, 2 (started: 2)" in section.missing
    assert [line.partition(",")[0] for line in section.missing] == ["Random"] * 2 + ["Frontier"] + ["DEUX"] * 2
    assert contents.missing == len(section.runs.missing)
    assert section.commands == (
        "python -m deux -m explore=deux,random model=kbnet,voiced seed=0,1,2",
        "python -m deux explore=frontier 'scenes.test=[1, 2]'",
    )
    assert contents.notes == ("None of 2 runs is finished: python -m deux -m explore=novelty seed=5,6",)


def test_a_sweep_over_other_options_reports_how_many_runs_it_lacks(write_run, write_sweep, outputs, names):
    write_sweep(["explore=deux,random", "scenes.train=1,2,4", "collect.processes=1,2"])
    write_run("random", "kbnet", 0, 20.0, scenes__train=1)
    write_run("deux", "kbnet", 0, 20.0, scenes__train=1)
    command = "python -m deux -m explore=deux,random scenes.train=1,2,4 collect.processes=1,2"
    assert read_contents(outputs, names).notes == (f"2 of 6 runs are finished: {command}",)
    for scenes in (2, 4):
        for explorer in ("random", "deux"):
            write_run(explorer, "kbnet", 0, 20.0, name=f"{explorer}-{scenes}", scenes__train=scenes)
    assert read_contents(outputs, names).notes == ()


def test_a_sweep_over_other_options_of_which_nothing_is_finished_is_counted_whole(
    write_run, write_sweep, outputs, names
):
    write_run("random", "kbnet", 0, 20.0, folder="alone")
    write_sweep(["explore=deux,random", "scenes.train=1,2,4"], folder="never")
    (note,) = read_contents(outputs, names).notes
    assert note.startswith("None of 6 runs is finished: ")


def test_an_unknown_first_dataset_is_a_mistake(write_run, outputs, names):
    write_run("random", "kbnet", 0, 20.0)
    with pytest.raises(DeuxError, match=r"report\.first=mp3d is not a dataset"):
        read_contents(outputs, names, first="mp3d")


def test_errors_of_corrected_depth_have_a_table_of_their_own(write_run, outputs, names):
    for seed in range(2):
        for explorer, mae, corrected in (("random", 20.0, 15.0), ("deux", 18.0, 16.0), ("frontier", 19.0, None)):
            path = write_run(explorer, "kbnet", seed, mae + seed) / "results.json"
            if corrected is not None:
                errors = {"mae": corrected, "rmse": 40.0, "imae": 30.0, "irmse": 90.0}
                path.write_text(json.dumps({**json.loads(path.read_text()), "corrected": errors}))
    contents = read_contents(outputs, names, baseline="random")
    (section,), (table,) = contents.sections, contents.corrected
    assert table.caption == f"Depth corrected by the sparse points, {section.title}"
    assert table in contents.tables
    maes = {row.labels[0]: row.cells[0].estimate.mean for part in table.parts for row in part}
    assert maes == {"Interpolation": 80.0, "Random": 15.0, "DEUX": 16.0}
    assert any("DEUX +1.0 ± 0.0" in note for note in table.notes)
    assert section.runs.missing == ()


def test_without_errors_of_corrected_depth_there_is_no_table_of_them(write_run, outputs, names):
    write_run("random", "kbnet", 0, 20.0)
    assert read_contents(outputs, names).corrected == ()
