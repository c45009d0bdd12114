"""`callbacks=active_collection` from the command line: what the rounds leave behind, and that a killed run finds it."""

import csv
import json
import math
import pickle
import re
from pathlib import Path

import pytest
import torch

import deux as package
from deux.collection.pipeline import read_manifest
from deux.configuration import compose, sections_of
from deux.data.datamodule import TripletDataModule
from deux.data.dataset_reader import DatasetReader
from deux.metrics.model_errors import evaluate
from deux.options import construct
from deux.tasks import active_training
from deux.tasks.active_training import ActiveCollectionSettings, RoundCollector
from deux.tasks.checkpoints import weights_identity
from deux.tasks.datasets import Datasets
from deux.tasks.model_training import Training
from deux.training.rounds import RankResult, RoundRequest

ACTIVE = [
    "explore=deux",
    "callbacks=[active_collection]",
    "callbacks.active_collection.steps=8",
    "callbacks.active_collection.rounds=2",
    "training.steps=8",
    "training.sources=recent",
    "scenes.validation=1",
    "evaluation.validation_viewpoints=3",
    "trainer.precision=32-true",
]
"""One flat of eight frames, six of which have t-1 and t-2: round 1 comes after 1 step, round 2 after 4."""


def results(folder: Path) -> dict:
    return json.loads((folder / "results.json").read_text())


def table(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.fixture(scope="module")
def active(tiny, tmp_path_factory) -> Path:
    """The run folder of an active experiment; the folder above it takes the datasets."""
    outputs = tmp_path_factory.mktemp("active")
    outcome = tiny(outputs, *ACTIVE, f"hydra.run.dir={outputs}/run")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Round 2: 6 frames, " in outcome.out
    return outputs / "run"


def test_every_round_is_a_dataset_of_its_own_in_the_run_folder(active):
    found = json.loads((active / "rounds" / "rounds.json").read_text())
    seeds, models = set(), set()
    for number, one in enumerate(found, start=1):
        (name,) = one["datasets"]
        made_by = read_manifest(active / "rounds" / name)["specification"]
        weights = weights_identity(active / "rounds" / f"round{number:02d}.safetensors")
        assert (made_by["name"], made_by["model"]) == (f"round{number:02d}", f"{weights} in 32-true")
        seeds.add(made_by["seed"])
        models.add(weights)
    assert len(seeds | {0}) == len(models | {weights_identity(active)}) == 3


def test_the_results_tell_of_every_round(active):
    found = results(active)
    assert found["frames"] == 3 * 6
    assert [(one["round"], one["step"], one["frames"]) for one in found["rounds"]] == [(1, 1, 6), (2, 4, 6)]
    for one in found["rounds"]:
        assert set(one) == {"round", "step", "frames", "area", "uncertainty", "mae"}
        (record,) = active.glob(f"rounds/round{one['round']:02d}-*/data/*/uncertainty.csv")
        values = [float(row["uncertainty"]) for row in table(record)]
        known = [value for value in values if not math.isnan(value)]
        assert one["uncertainty"] == pytest.approx(sum(known) / len(known))
        assert 0.5 < one["area"] < 30


def test_the_error_of_a_round_is_that_of_the_model_that_explored(active):
    (validation,) = (active.parent / "datasets").glob("validation-*")
    for one in results(active)["rounds"]:
        model = package.load(active / "rounds" / f"round{one['round']:02d}.safetensors")
        batches = TripletDataModule(model, validation=[DatasetReader(validation)], batch_size=2).val_dataloader()
        assert one["mae"] == pytest.approx(evaluate(model, batches).metrics["mae"], rel=1e-4)


def test_log_and_figure_show_the_rounds(active):
    rows = [row for row in table(active / "logs/version_0/metrics.csv") if row["rounds/round"]]
    logged = [(float(row["step"]), float(row["rounds/mae"]), float(row["rounds/area"])) for row in rows]
    assert logged == [(one["step"], one["mae"], one["area"]) for one in results(active)["rounds"]]
    assert (active / "figures" / "rounds.png").stat().st_size > 1000


def test_interrupted_in_a_round_it_ends_like_an_unbroken_run(tiny, active, tmp_path, monkeypatch):
    calls = []

    def area_or_end(*arguments):
        calls.append(arguments)
        if len(calls) == 2:  # the second round's frames are there, and nothing else knows of them
            raise KeyboardInterrupt
        return measured(*arguments)

    measured = active_training.measure_explored_places
    folder = f"hydra.run.dir={tmp_path}/run"
    with monkeypatch.context() as patch:
        patch.setattr(active_training, "measure_explored_places", area_or_end)
        assert tiny(active.parent, *ACTIVE, folder).code == 130
    collected = {path: path.stat().st_mtime_ns for path in tmp_path.glob("run/rounds/round*/**/*")}
    assert len([path for path in collected if path.name == "manifest.json"]) == 2
    outcome = tiny(active.parent, *ACTIVE, folder)
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"8 of 8 round02 frames usable, 6 with training.sources=recent,\s+collected before", outcome.out)
    assert collected == {path: path.stat().st_mtime_ns for path in collected}
    mine, theirs = results(tmp_path / "run"), results(active)
    assert mine["rounds"] == theirs["rounds"]
    assert mine["metrics"] == pytest.approx(theirs["metrics"], rel=1e-6)


@pytest.fixture
def collector(active, tiny_arguments) -> RoundCollector:
    sections = sections_of(compose(tiny_arguments(active.parent, *ACTIVE)))
    datasets = Datasets(sections)
    recipe = Training(sections, datasets, 1).recipe
    settings = construct(ActiveCollectionSettings, sections.plain("callbacks")["active_collection"], "callbacks")
    explorer = sections.plugin("explore")
    return RoundCollector(datasets, settings, explorer, recipe, active / "rounds", [], sections.seed)


def request(collector: RoundCollector, number: int, **changes) -> RoundRequest:
    return RoundRequest(number, 1, collector.recipe.model.create().eval(), "32-true", **changes)


def test_a_round_that_was_begun_is_finished_with_the_weights_of_its_beginning(collector):
    found = collector(request(collector, 1))  # other weights: a GPU need not come to the same ones again
    assert [found.dataset] == list(collector.folder.glob("round01-*"))


def test_the_model_of_a_round_can_travel_to_other_processes(collector, monkeypatch):
    given = []

    def explored_in_round(explorer, predictor, *others):
        given.append(predictor)
        return next(collector.folder.glob("round01-*"))

    monkeypatch.setattr(collector._datasets, "explored_in_round", explored_in_round)
    collector(request(collector, 1))
    (predictor,) = given
    assert predictor.precision == "32-true"
    frame = torch.rand(1, 3, 48, 48), torch.rand(1, 1, 48, 48), torch.eye(3)[None]
    assert torch.equal(pickle.loads(pickle.dumps(predictor))(*frame), predictor(*frame))
    assert torch.equal(package.load(collector.folder / "round01.safetensors").predict(*frame), predictor(*frame))


def test_a_process_without_a_scene_collects_nothing(collector):
    assert collector(request(collector, 1, rank=1, world_size=2)) == RankResult(None)


def test_an_explorer_without_a_model_can_stand_beside(tiny, active):
    options = [
        "task=train",
        "training.steps=2",
        "training.sources=recent",
        "callbacks=[active_collection]",
        "callbacks.active_collection.steps=8",
        "callbacks.active_collection.mode=replace",
    ]
    folder = active.parent / "control"
    outcome = tiny(
        active.parent,
        "explore=random",
        "training.steps=2",
        "training.sources=recent",
        *options,
        f"hydra.run.dir={folder}",
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert "1 of callbacks.active_collection.rounds=3 rounds took place" in outcome.out
    (found,) = json.loads((folder / "rounds" / "rounds.json").read_text())
    assert (found["frames"], found["uncertainty"], found["mae"]) == (6, None, None)


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (["callbacks=[activ_collection]"], "there is no callback called 'activ_collection': did you mean active"),
        (
            ["callbacks=[active_collection]", "callbacks.active_collection.mode=ad"],
            "callbacks.active_collection.mode cannot be 'ad': did you mean add?",
        ),
        (
            ["callbacks=[active_collection]", "callbacks.active_collection.evry=2"],
            "callbacks.active_collection.evry is not an option of",
        ),
        (
            ["callbacks=[active_collection]", "callbacks.active_collection.steps=2"],
            "callbacks.active_collection.steps is 2: it must be at least 3.",
        ),
        (
            ["callbacks=[active_collection]", "callbacks.active_collection.every=0.25"],
            "callbacks.active_collection.every=0.25 is less than an epoch, and rounds take place at the end of epochs: "
            "with callbacks.active_collection.unit=fraction",
        ),
        (
            ["callbacks=[active_collection]", "+trainer.reload_dataloaders_every_n_epochs=2"],
            "trainer.reload_dataloaders_every_n_epochs=2 would ignore frames that are collected during the training",
        ),
        (
            ["callbacks=[early_stopping]", "callbacks.early_stopping.monitor=val_loss", "scenes.validation=1"],
            "callbacks.early_stopping.monitor=val_loss is not logged by this training: did you mean validation",
        ),
        (
            ["callbacks=[early_stopping]", "callbacks.early_stopping.monitor=validation/mae"],
            "callbacks.early_stopping.monitor=validation/mae is not logged by this training, which has no validation "
            "frames: there is: train/color_consistency, train/learning_rate,",
        ),
        (
            ["callbacks=[ema_weight_averaging]", "training.averaging=0.3"],
            "training.averaging=0.3 and the callback EMAWeightAveraging both average the weights of the trained "
            "model: leave one of them out, such as by training.averaging=0.",
        ),
    ],
)
def test_mistakes_are_reported_in_one_sentence(tiny, tmp_path, overrides, sentence):
    assert tiny(tmp_path, "explore=random", *overrides).sentence.startswith(sentence)
    assert not list(tmp_path.glob("datasets/*"))


def test_a_sweep_does_not_start_itself_again(tiny, tmp_path):
    outcome = tiny(tmp_path, "explore=random", "seed=0,1", "trainer.strategy=ddp", "trainer.devices=2", "-m")
    assert outcome.code == 1
    assert "a sweep (-m) with trainer.devices=2 would start the whole sweep again" in outcome.err


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_two_processes_go_through_a_whole_experiment(experiment, tmp_path):
    options = [option for option in ACTIVE if not option.startswith("trainer")]
    together = ["trainer.accelerator=cpu", "trainer.strategy=ddp", "trainer.devices=2", "trainer.precision=32-true"]
    process = experiment(tmp_path, *options, "training.steps=12", *together)
    assert process.returncode == 0, process.stderr
    found = results(tmp_path / "run")
    assert [one["frames"] for one in found["rounds"]] == [12, 12]  # two flats, one for each process
    assert len(list(tmp_path.glob("run/rounds/round*-*/manifest.json"))) == 4
    assert process.stdout.count("Train kbnet on the deux frames") == 1
