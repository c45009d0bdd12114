import json
import shlex


def test_the_printed_command_evaluates_on_the_frames_of_the_same_command(tiny, deux, tmp_path):
    """Without the options of scenes and camera it would be on the default's flats at the default's size."""
    chosen = ["seed=3", "explore=random", "camera.hfov=80", "evaluation.viewpoints=2", "training.learning_rate=1e-4"]
    outcome = tiny(tmp_path, "task=train", *chosen, f"hydra.run.dir={tmp_path}/run")
    assert (outcome.code, outcome.err) == (0, "")
    printed = shlex.split(outcome.out.rpartition("Trained. To evaluate it: python -m deux ")[2])
    assert not {"task=train", "training.learning_rate=1e-4"} & {*printed}
    outcome = deux(*printed, f"hydra.run.dir={tmp_path}/tested")
    assert (outcome.code, outcome.err) == (0, "")
    found = json.loads((tmp_path / "tested/run.json").read_text())
    trained = json.loads((tmp_path / "run/run.json").read_text())
    for section in ("seed", "camera", "scenes", "evaluation", "sampling", "verification", "robot", "simulator"):
        if section == "evaluation":
            assert found[section] == trained[section] | {"checkpoint": f"{tmp_path}/run"}
        else:
            assert found[section] == trained[section]
