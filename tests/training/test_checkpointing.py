import importlib.util
import os
import shutil
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import pytest
import torch
from lightning.pytorch import Callback

from deux.callbacks import make_callback
from deux.errors import DeuxError
from deux.metrics.mean_errors import DepthErrors
from deux.testing.losses import perfect_sample
from deux.training.checkpointing import ResumedFrom, resume_checkpoints, resume_point
from deux.training.health import HealthCheck
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective
from deux.training.schedule import Schedule

pytestmark = [
    # Lightning 2.6 uses what newer PyTorch releases deprecate.
    pytest.mark.filterwarnings(r"ignore:.isinstance\(treespec, LeafSpec\):FutureWarning"),
    # What `deux.tasks.console` silences, too.
    pytest.mark.filterwarnings("ignore:Found 1 module.s. in eval mode"),
    pytest.mark.filterwarnings("ignore:You have overridden `on_after_batch_transfer`"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers"),
    pytest.mark.filterwarnings("ignore:.*is smaller than the logging interval"),
]


class LossRecorder(Callback):
    def __init__(self, kill_at=None):
        self.losses = []
        self.places = []
        self.kill_at = kill_at

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if trainer.global_step == self.kill_at:
            raise Killed
        self.places.append((trainer.current_epoch, batch_idx))

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        self.losses.append(float(outputs["loss"]))


class Killed(Exception):
    pass


@pytest.fixture
def train(small_model, fit):
    """Trains anew or from a checkpoint, up to a number of epochs of two steps; returns the losses of the steps."""

    def run(epochs, folder=None, resume=None):
        torch.manual_seed(len(str(resume)))  # a resumed run owes nothing to how its weights were initialised
        model = small_model()
        module = DepthCompletion(
            model,
            make_objective(model),
            schedule=Schedule(3e-3, boundaries=(3,), factors=(0.5,), unit="epoch", warmup_steps=3),
            metrics=DepthErrors(),
        )
        recorder = LossRecorder()
        callbacks = [recorder, HealthCheck(), *(resume_checkpoints(folder, minutes=10.0) if folder else [])]
        fit(
            module,
            perfect_sample().batch,
            copies=2,
            checkpoint=resume,
            max_epochs=epochs,
            callbacks=callbacks,
            enable_checkpointing=bool(folder),
            limit_val_batches=1.0,
        )
        return recorder.losses

    return run


@pytest.fixture
def places(small_model, fit, tmp_path):
    """Trains for so many steps in epochs of three, or until it is killed; returns each step's (epoch, batch)."""

    def run(kill_at=None, **limits):
        recorder, model = LossRecorder(kill_at), small_model()
        with nullcontext() if kill_at is None else pytest.raises(Killed):
            fit(
                DepthCompletion(model, make_objective(model)),
                perfect_sample().batch,
                copies=3,
                checkpoint=resume_point(tmp_path),
                callbacks=[recorder, *resume_checkpoints(tmp_path, minutes=10.0)],
                enable_checkpointing=True,
                reload_dataloaders_every_n_epochs=1,
                **limits,
            )
        return recorder.places

    return run


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
@pytest.mark.parametrize(
    "validation",
    [{}, {"limit_val_batches": 1, "val_check_interval": 2, "check_val_every_n_epoch": None}],
)
@pytest.mark.parametrize(("kill_at", "first"), [(4, 3), (7, 6)])
def test_a_resumed_run_that_counts_steps_leaves_no_batch_of_the_next_epoch_out(places, validation, kill_at, first):
    places(kill_at, max_steps=10, **validation)
    whole = [(step // 3, step % 3) for step in range(10)]
    assert places(max_steps=10, **validation) == whole[first:]


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
def test_a_resumed_run_goes_on_as_if_it_had_not_stopped(train, tmp_path):
    whole = train(epochs=4)
    train(epochs=2, folder=tmp_path)
    checkpoint = resume_point(tmp_path)
    assert checkpoint is not None
    assert train(epochs=4, folder=tmp_path, resume=checkpoint) == whole[4:]


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
def test_a_run_that_was_moved_goes_on_without_a_warning(train, tmp_path):
    """Lightning's is about a choice of the best checkpoint, which is not made here; warnings are errors in tests."""
    whole = train(epochs=4)
    train(epochs=2, folder=tmp_path / "before")
    (tmp_path / "before").rename(tmp_path / "after")
    assert train(epochs=4, folder=tmp_path / "after", resume=resume_point(tmp_path / "after")) == whole[4:]
    assert [path.name for path in tmp_path.rglob("*.ckpt")] == ["epoch=3-step=8.ckpt"]


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
def test_what_a_kill_between_two_checkpoints_left_is_deleted(train, tmp_path):
    """The older one was not deleted yet, and no state of the training names it."""
    train(epochs=2, folder=tmp_path)
    (newest,) = tmp_path.glob("*.ckpt")
    for name in ("epoch=0-step=2.ckpt", "within-epoch=0-step=1.ckpt", "mine.ckpt"):
        shutil.copy(newest, tmp_path / name)
    train(epochs=3, folder=tmp_path, resume=newest)
    left = {path.name for path in tmp_path.glob("*.ckpt")}
    assert left == {"epoch=2-step=6.ckpt", "within-epoch=0-step=1.ckpt", "mine.ckpt"}  # `within-` names no newer one


_spec = importlib.util.spec_from_file_location("active_run", Path(__file__).with_name("active_run.py"))
assert _spec is not None
active_run = importlib.util.module_from_spec(_spec)
sys.modules.setdefault("active_run", active_run)
_spec.loader.exec_module(active_run)


class BatchRecorder(Callback):
    """Keeps (epoch, batch, images' digest) of every batch, and the steps at which it was validated."""

    def __init__(self, kill_at=None):
        self.kill_at, self.batches, self.validated = kill_at, [], []

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if (trainer.current_epoch, batch_idx) == self.kill_at:
            raise active_run.Killed
        self.batches.append((trainer.current_epoch, batch_idx, active_run.digest(batch.image.numpy())))

    def on_validation_start(self, trainer, pl_module):
        if self.kill_at == ("validation", trainer.global_step):
            raise active_run.Killed
        self.validated.append(trainer.global_step)


# Epochs of six batches of two frames.
RUNS = {
    "steps": {"settings": {"steps": 15}},
    "epochs": {"settings": {"steps": None, "epochs": 3}},
    "loader processes": {"settings": {"steps": 15, "num_workers": 2}},
    "accumulated gradients": {"settings": {"steps": 7}, "trainer": {"accumulate_grad_batches": 2}},
    "float64": {"settings": {"steps": None, "epochs": 3}, "trainer": {"precision": "64-true"}},
    "averaged weights": {"settings": {"steps": 15}, "averaged": True},
    "validation": {"settings": {"steps": 15, "validations": 5}, "validate": True},
}
KILLS = [(0, 1), (0, 4), (0, 5), (1, 0), (1, 3)]
"""Epoch and batch before which a run is killed."""

CASES = [("steps", kill_at) for kill_at in KILLS]
CASES += [("epochs", kill_at) for kill_at in ((0, 4), (1, 0))]
CASES += [(kind, (1, 3)) for kind in ("loader processes", "float64", "averaged weights")]
CASES += [("accumulated gradients", kill_at) for kill_at in ((0, 4), (1, 3))]  # between two steps, and within one
CASES += [("validation", kill_at) for kill_at in ((0, 4), (1, 3))]
CASES += [("validation", ("validation", step)) for step in (3, 6)]  # within an epoch, and at its end


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    """Weights, batches and validations of a run of this kind that nobody disturbed."""
    found = {}

    def run(kind):
        if kind not in found:
            found[kind] = recorded_run(tmp_path_factory.mktemp("unbroken"), kind)
        return found[kind]

    return run


def recorded_run(folder, kind, kill_at=None, callbacks=(), checkpoint_minutes=0.0):
    """Train until it is killed or over; with 0 minutes there is a checkpoint after every step."""
    recorder, options = BatchRecorder(kill_at), dict(RUNS[kind])
    if options.pop("averaged", False):
        callbacks = [make_callback("ema_weight_averaging", {"decay": 0.5})]
    settings = {"batch_size": 2, "checkpoint_minutes": checkpoint_minutes} | options["settings"]
    with nullcontext() if kill_at is None else pytest.raises(active_run.Killed):
        model, _ = active_run.train(
            folder, **(options | {"settings": settings}), rounds={"every": 99}, callbacks=[*callbacks, recorder]
        )
    if kill_at is not None:
        return None, recorder.batches, recorder.validated
    weights = torch.cat([value.flatten() for value in model.state_dict().values()])
    return weights, recorder.batches, recorder.validated


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
@pytest.mark.parametrize(("kind", "kill_at"), CASES)
def test_killed_within_an_epoch_it_goes_on_there_and_ends_like_an_unbroken_run(unbroken, tmp_path, kind, kill_at):
    weights, batches, validated = unbroken(kind)
    _, before, validated_before = recorded_run(tmp_path, kind, kill_at)
    found, after, validated_after = recorded_run(tmp_path, kind)
    assert torch.equal(found, weights)
    assert before[: len(batches) - len(after)] + after == batches
    assert len(before) + len(after) - len(batches) <= 2, "more than a step was made twice"
    assert sorted(set(validated_before + validated_after)) == validated


class Clock(Callback):
    """Lets an hour pass during one batch of the first epoch."""

    def __init__(self, monkeypatch, slow_batch):
        self.slow_batch, self.hours = slow_batch, 0
        real = time.monotonic
        monkeypatch.setattr(time, "monotonic", lambda: real() + 3600 * self.hours)

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        self.hours += (trainer.current_epoch, batch_idx) == (0, self.slow_batch)


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
def test_checkpoints_within_an_epoch_come_by_time_and_after_whole_steps(unbroken, tmp_path, monkeypatch):
    """Time is up after the first of two batches whose gradients are accumulated."""
    options, kind = {"checkpoint_minutes": 30.0}, "accumulated gradients"
    clock = Clock(monkeypatch, slow_batch=2)
    recorded_run(tmp_path, kind, kill_at=(0, 5), callbacks=[clock], **options)
    assert [path.name for path in (tmp_path / "checkpoints").iterdir()] == ["within-epoch=0-step=2.ckpt"]
    weights, batches, _ = recorded_run(tmp_path, kind, **options)
    assert torch.equal(weights, unbroken(kind)[0])
    assert batches == unbroken(kind)[1][4:]


def test_only_the_newest_checkpoint_stays_and_it_loads_without_code(train, tmp_path):
    train(epochs=3, folder=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["epoch=2-step=6.ckpt"]
    assert torch.load(tmp_path / "epoch=2-step=6.ckpt", weights_only=True)["global_step"] == 6


def test_a_damaged_checkpoint_is_passed_over(tmp_path):
    torch.save({"global_step": 1, "state_dict": {}}, tmp_path / "old.ckpt")
    whole = (tmp_path / "old.ckpt").read_bytes()
    (tmp_path / "new.ckpt").write_bytes(whole[: len(whole) // 2])
    os.utime(tmp_path / "old.ckpt", (1, 1))
    with pytest.warns(UserWarning, match=r"new\.ckpt cannot be read"):
        assert resume_point(tmp_path) == tmp_path / "old.ckpt"


def test_no_checkpoint(tmp_path):
    assert resume_point(tmp_path) is None
    assert resume_point(tmp_path / "missing") is None


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
@pytest.mark.parametrize(
    "change",
    [
        {"state_dict": {}},
        {"state_dict": {"model.weight": torch.zeros(3, 3)}},
        {"optimizer_states": [{}]},
        {"loops": {"fit_loop": 3}},
        {"callbacks": []},
    ],
)
def test_a_checkpoint_of_another_training_is_named(places, tmp_path, small_model, fit, change):
    places(max_steps=3)
    point = resume_point(tmp_path)
    torch.save(torch.load(point, weights_only=True) | change, point)
    resumed, model = ResumedFrom(point), small_model()
    with (
        pytest.raises(DeuxError, match=r"\.ckpt is damaged or of another training \(.*\): delete it"),
        resumed.restoring(),
    ):
        fit(
            DepthCompletion(model, make_objective(model)),
            perfect_sample().batch,
            copies=3,
            checkpoint=point,
            callbacks=[*resume_checkpoints(tmp_path, minutes=10.0), resumed],
            enable_checkpointing=True,
            reload_dataloaders_every_n_epochs=1,
            max_steps=5,
        )


@pytest.mark.parametrize("content", [None, [], {}, {"epoch": 0}, {"state_dict": None}])
def test_what_is_no_checkpoint_is_passed_over(tmp_path, content):
    torch.save(content, tmp_path / "a.ckpt")
    with pytest.warns(UserWarning, match=r"a\.ckpt cannot be read and is passed over: it holds no state_dict"):
        assert resume_point(tmp_path) is None


class Requeued(Callback):
    """Writes the checkpoint of Lightning's answer to Slurm's signal in some hook of a step, and ends the process."""

    def __init__(self, hook, step):
        self.step = step
        setattr(self, hook, self.end)

    def end(self, trainer, *_):
        if trainer.global_step == self.step:
            trainer.save_checkpoint(trainer._checkpoint_connector.hpc_save_path(trainer.default_root_dir))
            raise active_run.Killed


class Begun(Callback):
    """The step that a training goes on from."""

    def on_train_start(self, trainer, pl_module):
        self.step = trainer.global_step


def flat(model):
    return torch.cat([weight.detach().flatten() for weight in model.parameters()])


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
@pytest.mark.parametrize(
    ("accumulate", "hook"), [(1, "on_before_backward"), (2, "on_before_backward"), (1, "on_train_batch_end")]
)
def test_a_training_goes_on_from_where_slurm_took_it_off_a_node(tmp_path, accumulate, hook):
    """Within a step, or after it; a later checkpoint of its own takes the place of that one."""
    settings = {"steps": 11, "batch_size": 2, "checkpoint_minutes": 10.0}
    trainer = {"accumulate_grad_batches": accumulate}
    whole, _ = active_run.train(tmp_path / "whole", settings, {"every": 999}, trainer)
    with pytest.raises(active_run.Killed):
        active_run.train(tmp_path / "cut", settings, {"every": 999}, trainer, callbacks=[Requeued(hook, 8)])
    (left,) = (tmp_path / "cut").glob("hpc_ckpt_*.ckpt")
    assert resume_point(tmp_path / "cut" / "checkpoints") == left
    begun = Begun()
    model, _ = active_run.train(tmp_path / "cut", settings, {"every": 999}, trainer, callbacks=[begun])
    assert begun.step == 8
    assert torch.equal(flat(model), flat(whole))
    assert not left.exists()


@pytest.mark.filterwarnings("ignore:Checkpoint directory .* exists and is not empty")
def test_a_training_that_slurm_took_off_a_node_between_epochs_ends_its_epoch_again(tmp_path):
    """What comes at the end of an epoch, such as a round of active collection, is not left out."""
    settings = {"steps": 11, "checkpoint_minutes": 10.0}
    with pytest.raises(active_run.Killed):
        active_run.train(tmp_path, settings, {"every": 999}, callbacks=[Requeued("on_train_epoch_end", 9)])
    assert [*tmp_path.glob("hpc_ckpt_*.ckpt")]
    assert resume_point(tmp_path / "checkpoints").name == "epoch=1-step=6.ckpt"
