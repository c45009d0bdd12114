import yaml

from deux.report.sweeps import find_sweeps


def test_the_grid_is_the_presets_and_the_command_line_wins(write_sweep, outputs):
    params = {"seed": "0,1,2", "model": "kbnet,voiced", "explore": "random,deux"}
    folder = write_sweep(["experiment=table1", "model=kbnet", "seed=range(3,5)"], params)
    (sweep,) = find_sweeps(outputs)
    assert sweep.folder == folder
    assert sorted(sweep.grid) == [
        ("deux", "kbnet", 3),
        ("deux", "kbnet", 4),
        ("random", "kbnet", 3),
        ("random", "kbnet", 4),
    ]
    assert sweep.command == "python -m deux -m experiment=table1 model=kbnet 'seed=range(3,5)'"


def test_what_is_not_swept_over_is_the_configurations(write_sweep, outputs):
    write_sweep(["explore=random,deux"], seed=4)
    (sweep,) = find_sweeps(outputs)
    assert sorted(sweep.grid) == [("deux", "kbnet", 4), ("random", "kbnet", 4)]


def test_other_tasks_and_damaged_files_are_left_out(write_sweep, outputs):
    write_sweep(["explore=random"], folder="a", task="collect")
    write_sweep(["seed=a,b"], folder="b")
    (write_sweep(["explore=random"], folder="c") / "multirun.yaml").write_text("{")
    (write_sweep(["explore=random"], folder="d") / "multirun.yaml").write_text("")
    write_sweep(["explore=a=b,,"], folder="e")
    assert find_sweeps(outputs) == []


def test_a_sweep_of_an_older_version_is_read(write_sweep, outputs):
    folder = write_sweep(["explore=random,deux", "random_seed=0,1"])
    content = yaml.safe_load((folder / "multirun.yaml").read_text())
    content |= {"random_seed": 0, "seed": {"checkpoint": None, "steps": 5}}
    (folder / "multirun.yaml").write_text(yaml.safe_dump(content))
    (sweep,) = find_sweeps(outputs)
    assert sorted(sweep.grid) == [
        ("deux", "kbnet", 0),
        ("deux", "kbnet", 1),
        ("random", "kbnet", 0),
        ("random", "kbnet", 1),
    ]
    (folder / "multirun.yaml").write_text(
        yaml.safe_dump(
            {**content, "random_seed": 4, "hydra": {**content["hydra"], "overrides": {"task": [], "hydra": []}}}
        )
    )
    (sweep,) = find_sweeps(outputs)
    assert sweep.grid == [("deux", "kbnet", 4)]
