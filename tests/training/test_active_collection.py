"""Which frames a training is shown while it collects more: unbroken, killed and resumed, and in two processes."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from lightning.pytorch import Callback

from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.training.rounds import RankResult, RoundRequest, RoundSettings, merge_results

PROGRAM = Path(__file__).with_name("active_run.py")
_spec = importlib.util.spec_from_file_location("active_run", PROGRAM)
assert _spec is not None
active_run = importlib.util.module_from_spec(_spec)
sys.modules["active_run"] = active_run
_spec.loader.exec_module(active_run)

# What `deux.tasks.console` silences, too.
NOTICES = (
    "Checkpoint directory .* exists and is not empty",
    "Found 1 module.s. in eval mode",
    "You have overridden `on_after_batch_transfer`",
    ".*does not have many workers",
    ".*is smaller than the logging interval",
)
pytestmark = [pytest.mark.filterwarnings(f"ignore:{notice}") for notice in NOTICES]

FIRST = 12
"""Frames that the training begins with, and that each round brings: two scenes, 8 steps of which 2 lack sources."""


def shown(folder: Path, rank: int = 0) -> dict[int, Counter[str]]:
    """How often each frame was shown in each epoch; a step that was taken again counts as it was taken last."""
    lines = [line.split() for line in (folder / f"seen{rank}.txt").read_text().splitlines()]
    epochs: dict[int, Counter[str]] = {}
    for epoch, found in {int(step): (int(epoch), found) for epoch, step, *found in lines}.values():
        epochs.setdefault(epoch, Counter()).update(found)
    return epochs


def frames(*datasets: Path) -> Counter[str]:
    """Each frame of some datasets once, by its image as it is on disk."""
    readers = [DatasetReader(dataset) for dataset in datasets]
    shown = [reader.image(one.target) for reader in readers for one in reader.triplets("train", ())]
    return Counter(map(active_run.digest, shown))


def collected(folder: Path, name: str) -> list[Path]:
    return sorted((folder / "rounds").glob(f"{name}-*"))


def weights(model: torch.nn.Module) -> torch.Tensor:
    return torch.cat([value.flatten() for value in model.state_dict().values()])


MEASURES = {
    "steps": {"steps": 20},
    "averaged epochs": {"steps": None, "epochs": 4, "averaging": 0.3},
}


@pytest.fixture(scope="module")
def unbroken_runs(tmp_path_factory) -> Callable[[str], Path]:
    """The folder of a run that nobody disturbed, measured in one of `MEASURES`."""
    folders: dict[str, Path] = {}

    def run(measure: str) -> Path:
        if measure not in folders:
            folders[measure] = folder = tmp_path_factory.mktemp(measure)
            model, active = active_run.train(folder, MEASURES[measure])
            torch.save(weights(model), folder / "weights.pt")
            (folder / "rounds.json").write_text(json.dumps(active.state_dict()["rounds"]))
        return folders[measure]

    return run


@pytest.fixture
def unbroken(unbroken_runs) -> Path:
    return unbroken_runs("steps")


def test_every_epoch_shows_every_frame_that_there_is(unbroken):
    first, one, two = (frames(*collected(unbroken, name)) for name in ("first", "round1", "round2"))
    assert [found.total() for found in (first, one, two)] == [FIRST] * 3
    assert shown(unbroken)[0] == first
    assert shown(unbroken)[1] == first + one
    assert shown(unbroken)[2] == first + one + two
    assert shown(unbroken)[3].total() == 20 * 4 - FIRST * 6  # what was left of the steps


def test_what_is_known_of_each_round(unbroken):
    one, two = json.loads((unbroken / "rounds.json").read_text())
    assert (one["round"], one["step"], one["frames"], one["area"]) == (1, 3, FIRST, 2)
    assert (two["round"], two["step"], two["datasets"]) == (2, 9, [collected(unbroken, "round2")[0].name])


def test_frames_can_be_replaced(tmp_path):
    active_run.train(tmp_path, rounds={"mode": "replace"}, settings={"steps": 9})
    assert shown(tmp_path) == dict(enumerate(frames(*collected(tmp_path, n)) for n in ("first", "round1", "round2")))


def test_a_run_that_is_measured_in_epochs_collects_too(tmp_path):
    _, active = active_run.train(tmp_path, settings={"steps": None, "epochs": 3})
    assert [one.step for one in active.rounds] == [3, 9]
    assert [found.total() for found in shown(tmp_path).values()] == [FIRST, 2 * FIRST, 3 * FIRST]


class Course(Callback):
    """The weights and the learning rate after each step."""

    def __init__(self):
        self.weights, self.rates = [], []

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        self.weights.append(weights(pl_module.model).clone())
        self.rates.append(trainer.optimizers[0].param_groups[0]["lr"])


def test_fractions_of_a_training_in_epochs_are_of_the_epochs(tmp_path):
    """Four epochs of 3, 6, 9 and 9 steps: half of them are 9 steps, and the last 0.3 are 9 steps and 2 of the third."""
    course = Course()
    settings = {"steps": None, "epochs": 4, "averaging": 0.3, "boundaries": (0.5,), "factors": (0.1,)}
    model, _ = active_run.train(tmp_path, settings, callbacks=[course])
    assert course.rates == pytest.approx([0.01] * 8 + [0.001] * 19)
    torch.testing.assert_close(weights(model), torch.stack(course.weights[-11:]).mean(dim=0), rtol=1e-5, atol=1e-7)


def test_no_round_comes_when_the_training_is_over(tmp_path):
    assert active_run.train(tmp_path / "steps", settings={"steps": 3})[1].rounds == []
    assert active_run.train(tmp_path / "epochs", settings={"steps": None, "epochs": 1})[1].rounds == []


class Stop(Callback):
    """Kills the run after a round and before its checkpoint is written."""

    def on_train_epoch_end(self, trainer, pl_module):
        raise active_run.Killed


def stops_inside(folder):
    """Kills the run in the middle of its first exploration."""
    render = active_run.ToySimulator.render

    def collect(request):
        def render_or_die(simulator, poses, channels):
            if len(list(folder.glob("rounds/.round1-*/data/*/image/0*"))) >= 5:
                raise active_run.Killed
            return render(simulator, poses, channels)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(active_run.ToySimulator, "render", render_or_die)
            return active_run.collect_in(folder / "rounds", [])(request)

    return collect


KILLS = {
    "in the epoch after the first round": (lambda folder: {"kill_at": 5}, [2]),
    "after the second round": (lambda folder: {"kill_at": 10}, []),
    "between a round and its checkpoint": (lambda folder: {"callbacks": [Stop()]}, [1, 2]),
    "during a round": (lambda folder: {"collect": stops_inside(folder)}, [1, 2]),
}
"""How to kill a run, and the rounds that the resumed one asks for."""


@pytest.mark.parametrize("kill", KILLS)
@pytest.mark.parametrize("measure", MEASURES)
def test_killed_and_resumed_it_ends_like_an_unbroken_run(unbroken_runs, tmp_path, kill, measure):
    (arrange, expected), settings, unbroken = KILLS[kill], MEASURES[measure], unbroken_runs(measure)
    with pytest.raises(active_run.Killed):
        active_run.train(tmp_path, settings, **arrange(tmp_path))
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("rounds/round*/**/*")}
    asked: list[int] = []
    model, active = active_run.train(tmp_path, settings, collect=active_run.collect_in(tmp_path / "rounds", asked))
    assert asked == expected
    assert before == {path: path.stat().st_mtime_ns for path in before}  # a finished round is taken as it is
    assert shown(tmp_path) == shown(unbroken)
    assert torch.equal(weights(model), torch.load(unbroken / "weights.pt", weights_only=True))
    assert active.state_dict()["rounds"] == json.loads((unbroken / "rounds.json").read_text())


@pytest.mark.slow
def test_really_killed_it_sees_the_frames_of_an_unbroken_run(unbroken, tmp_path):
    process = subprocess.Popen([sys.executable, PROGRAM, tmp_path], start_new_session=True, stderr=subprocess.DEVNULL)
    seen, deadline = tmp_path / "seen0.txt", time.monotonic() + 200
    while not (seen.exists() and len(seen.read_text().splitlines()) > 4):  # the first round was after three steps
        assert process.poll() is None, "the run ended before it could be killed"
        assert time.monotonic() < deadline, "the run never came to where it was to be killed"
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    active_run.train(tmp_path)
    assert shown(tmp_path) == shown(unbroken)


def test_two_processes_share_scenes_and_frames(tmp_path):
    options = {"settings": {"steps": 9, "batch_size": 2}, "trainer": {"strategy": "ddp", "devices": 2}}
    alone = {name: value for name, value in os.environ.items() if name not in ("LOCAL_RANK", "WORLD_SIZE")}
    command = [sys.executable, str(PROGRAM), str(tmp_path), json.dumps(options)]
    done = subprocess.run(command, env=alone, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr
    parts = collected(tmp_path, "round1")
    assert sorted(path.name[:-3] for part in parts for path in (part / "data").iterdir()) == ["hall", "kitchen"]
    assert len(parts) == 2  # one scene each
    first, found = frames(*collected(tmp_path, "first")), frames(*parts)
    both = [shown(tmp_path, rank) for rank in (0, 1)]
    assert both[0][0] + both[1][0] == first
    assert both[0][1] + both[1][1] == first + found
    assert [one[1].total() for one in both] == [FIRST, FIRST]
    told = [json.loads((tmp_path / f"told{rank}.json").read_text()) for rank in (0, 1)]
    assert told == [{"told": [True, False, False, True], "leads": rank == 0} for rank in (0, 1)]


class States(Callback):
    """Keeps the state of the random generators and the modes of the modules at the end of each epoch."""

    def __init__(self):
        self.kept = []

    def on_train_epoch_end(self, trainer, pl_module):
        modes = [module.training for module in pl_module.modules()]
        self.kept.append((torch.get_rng_state().tolist(), np.random.get_state()[1].tolist(), modes))


def test_a_round_leaves_no_trace_in_the_model_and_in_what_is_random(tmp_path):
    asked: list[RoundRequest] = []

    def collect(request):
        torch.rand(3)
        np.random.rand(3)
        asked.append(request)
        assert not any(module.training for module in request.model.modules())
        return active_run.collect_in(tmp_path / "with" / "rounds", [])(request)

    with_rounds, without = States(), States()
    trainer = {"precision": "bf16-mixed"}
    active_run.train(tmp_path / "with", {"steps": 4}, {}, trainer, collect=collect, callbacks=[with_rounds])
    active_run.train(tmp_path / "without", {"steps": 4}, {"every": 9}, trainer, callbacks=[without])
    assert [(one.number, one.step, one.precision) for one in asked] == [(1, 3, "bf16-mixed")]
    assert with_rounds.kept[0] == without.kept[0]


@pytest.mark.parametrize("precision", ["64-true", "bf16-true"])
def test_the_model_explores_in_any_precision(tmp_path, precision):
    _, active = active_run.train(tmp_path, {"steps": 5}, trainer={"precision": precision})
    assert [one.frames for one in active.rounds] == [FIRST]


def test_a_trainer_that_would_not_read_new_frames_is_refused(tmp_path):
    with pytest.raises(DeuxError, match=r"reload_dataloaders_every_n_epochs=2 would ignore"):
        active_run.train(tmp_path, trainer={"reload_dataloaders_every_n_epochs": 2})


def test_frames_that_are_gone_are_missed(tmp_path):
    with pytest.raises(active_run.Killed):
        active_run.train(tmp_path, kill_at=5)
    (lost,) = collected(tmp_path, "round1")
    lost.rename(tmp_path / "elsewhere")
    with pytest.raises(DeuxError, match=f"{lost} is missing"):
        active_run.train(tmp_path)


@pytest.mark.parametrize(
    ("settings", "epochs", "fraction", "due"),
    [
        ({}, 1, 0.2, True),
        ({"every": 2}, 1, 0.2, False),
        ({"every": 2}, 2, 0.4, True),
        ({"every": 2}, 2, 1.0, False),
        ({"every": 0.25, "unit": "fraction"}, 7, 0.24, False),
        ({"every": 0.1, "unit": "fraction"}, 1, 0.3, True),
    ],
)
def test_when_the_first_round_is_due(settings, epochs, fraction, due):
    assert RoundSettings(**settings).due(1, epochs, fraction) is due


def test_later_rounds_are_as_far_apart_and_come_to_an_end():
    settings = RoundSettings(every=0.1, unit="fraction", rounds=3)
    assert [settings.due(number, 5, 0.3) for number in (1, 2, 3, 4)] == [True, True, True, False]
    assert not settings.due(3, 5, 0.29)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"every": 0}, r"callbacks\.active_collection\.every is 0: it must be above 0"),
        ({"rounds": 0}, r"callbacks\.active_collection\.rounds is 0"),
        (
            {"every": 2, "unit": "fraction"},
            r"active_collection\.every=2 is never reached.*callbacks\.active_collection\.unit=epoch",
        ),
    ],
)
def test_settings_that_make_no_rounds(settings, sentence):
    with pytest.raises(DeuxError, match=sentence):
        RoundSettings(**settings)


def test_the_results_of_the_processes_are_weighted_by_their_frames():
    request = RoundRequest(2, 40, None, "32-true")
    results = [
        RankResult(Path("/r/a"), 30, 5.0, 0.1, 250.0),
        RankResult(Path("/r/b"), 10, 2.0, 0.5),
        RankResult(None),
        RankResult(Path("/r/c"), 60, 1.0),
    ]
    found = merge_results(request, results, Path("/r"))
    assert (found.frames, found.area, found.mae) == (100, 8.0, 250.0)
    assert found.uncertainty == pytest.approx((30 * 0.1 + 10 * 0.5) / 40)
    assert found.datasets == ["a", "b", "c"]
    assert merge_results(request, [RankResult(Path("/r/a"), 3)], Path("/r")).uncertainty is None
