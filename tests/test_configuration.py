import copy
import json
import logging
import sys
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from pathlib import Path

import pytest
from omegaconf import DictConfig, OmegaConf

from deux.collection.collect_settings import CollectSettings
from deux.collection.sparse import SparseSettings
from deux.collection.verification import VerificationSettings
from deux.configuration import (
    OPEN_NODES,
    check_unused,
    compose,
    config_folder,
    in_sweep,
    run_id,
    sections_of,
    user_path,
)
from deux.contracts import Action, Episode, Explorer, Observation, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.options import REQUIRED, construct, options
from deux.plugin_kinds import KINDS, Plugin
from deux.registry import registry
from deux.task_sections import PLUGIN_SECTIONS, TASKS
from deux.tasks.compare_explorers import CompareSettings
from deux.tasks.datasets import Datasets
from deux.tasks.evaluate import EvaluationSettings
from deux.tasks.export import ExportSettings
from deux.tasks.export_dataset import ExportDatasetSettings
from deux.tasks.model_training import FoundationSettings, Training
from deux.tasks.predict import PredictSettings
from deux.tasks.report import ReportSettings
from deux.tasks.seed_model import SeedModel, SeedModelSettings
from deux.tasks.train_explorer import ExplorerTrainingSettings
from deux.training.training_settings import TrainingSettings

PLUGINS = [(section, name) for section, kind in PLUGIN_SECTIONS.items() for name in registry().names(kind)]
PRESETS = sorted(
    (group, path.stem)
    for group in ("scenes", "scale", "report", "callbacks", "experiment")
    for path in config_folder().glob(f"{group}/*")
    if (group, path.stem) not in PLUGINS
)


class Resting(Explorer):
    def __init__(self, patience: float = 1.0) -> None:
        self.patience = patience

    def reset(self, episode: Episode) -> None:
        pass

    def act(self, observation: Observation) -> Action:
        return Action.STOP


@pytest.fixture
def fresh_registry() -> Iterator[None]:
    """Lets a test install packages: the process's registry is made anew, before and after it."""
    registry.cache_clear()
    yield
    registry.cache_clear()


def install(folder: Path, name: str, entry_points: str, files: dict[str, str]) -> None:
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entry_points)
    for path, content in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(content)


def test_the_defaults_are_the_papers_pair_and_fit_their_constructors() -> None:
    cfg = compose()
    assert (cfg.task, cfg.model.name, cfg.explore.name, cfg.pose) == (
        "experiment",
        "kbnet",
        "deux",
        "simulator",
    )
    assert cfg.task in TASKS
    assert cfg.seed == 0
    assert cfg.seed_model.checkpoint == "kbnet-indoor"
    assert "hydra" not in cfg
    construct(Camera, cfg.camera, "camera")
    construct(Robot, cfg.robot, "robot")


@pytest.mark.parametrize(("group", "name"), PRESETS)
def test_every_preset_composes(group: str, name: str) -> None:
    cfg = compose([f"{group}={name}"])
    if group in PLUGIN_SECTIONS:
        assert (group, cfg[group].name) in PLUGINS


@pytest.mark.parametrize(("section", "name"), PLUGINS)
def test_every_option_of_every_plugin_can_be_given(section: str, name: str) -> None:
    kind = PLUGIN_SECTIONS[section]
    every = options(registry().get(kind, name), KINDS[kind].given).values()
    required = [f"{section}.{option.name}=there" for option in every if option.default is REQUIRED]
    composed = compose([f"{section}={name}", "task=train", *required])
    assert composed[section].name == name
    for option in every:
        if option.default is not REQUIRED:
            cfg = copy.deepcopy(composed)
            cfg[section][option.name] = list(option.default) if isinstance(option.default, tuple) else option.default
            chosen = sections_of(cfg).plugin(section)
            assert chosen.settings[option.name] == cfg[section][option.name], option.name


SECTION_OPTIONS = [
    ("evaluate", "camera", Camera),
    ("experiment", "robot", Robot),
    ("experiment", "collect", CollectSettings),
    ("experiment", "sampling", SparseSettings),
    ("experiment", "verification", VerificationSettings),
    ("experiment", "seed_model", SeedModelSettings),
    ("experiment", "foundation", FoundationSettings),
    ("experiment", "training", TrainingSettings),
    ("experiment", "evaluation", EvaluationSettings),
    ("train_explorer", "explorer_training", ExplorerTrainingSettings),
    ("compare_explorers", "compare", CompareSettings),
    ("predict", "predict", PredictSettings),
    ("export", "export", ExportSettings),
    ("export_dataset", "export_dataset", ExportDatasetSettings),
    ("report", "report", ReportSettings),
]


@pytest.mark.parametrize(("task", "section", "settings"), SECTION_OPTIONS, ids=lambda value: str(value))
def test_every_option_of_every_section_can_be_given(task: str, section: str, settings: type) -> None:
    made = sections_of(compose([f"task={task}"])).read(section, settings)
    given = [
        f"{section}.{name}={json.dumps(plain_value(getattr(made, name)))}"
        for name in options(settings)
        if not is_dataclass(getattr(made, name))
        and (not isinstance(getattr(made, name), Mapping | tuple) or not getattr(made, name))
    ]
    assert sections_of(compose([f"task={task}", *given])).read(section, settings) == made


def plain_value(value: object) -> object:
    return [] if value == () else value


@pytest.mark.parametrize("task", TASKS)
def test_every_section_of_a_task_is_in_the_configuration(task: str) -> None:
    cfg = compose([f"task={task}"])
    assert set(TASKS[task].sections) <= set(cfg)
    assert set(sections_of(cfg).identity) == {"task", *TASKS[task].sections}


def check(overrides: list[str]) -> None:
    check_unused(compose(overrides), overrides)


def test_epochs_beside_a_number_of_steps_are_refused() -> None:
    with pytest.raises(DeuxError, match=r"training.epochs=3 has no effect while training.steps is 1700: set training"):
        check(["training.epochs=3"])
    check(["training.epochs=3", "training.steps=null"])
    check(["experiment=published_kbnet", "training.steps=100"])


@pytest.mark.parametrize(
    ("task", "option"),
    [("train", "training_data"), ("evaluate", "evaluation.data"), ("export_dataset", "export_dataset.test")],
)
def test_a_reader_without_a_folder_of_recorded_frames_is_refused(task: str, option: str) -> None:
    with pytest.raises(DeuxError, match=rf"^data=void says how recorded frames are read and .*{option}= does; without"):
        check([f"task={task}", "data=void"])
    check([f"task={task}", "data=void", f"{option}=void_release"])
    check([f"task={task}", "data=deux"])
    check(["task=predict", "data=void"])


def test_a_task_reads_no_section_that_it_does_not_name() -> None:
    sections = sections_of(compose(["task=export"]))
    with pytest.raises(AssertionError, match="does not name the section 'collect'"):
        sections.plain("collect")


def test_mistakes_in_sections_that_a_task_does_not_name_do_not_stop_it() -> None:
    assert compose(["task=report", "explore.name=nowhere", "objective.nothing=1"]).task == "report"


def test_what_a_task_does_not_read_names_no_other_run_folder() -> None:
    assert run_id(compose(["task=export", "export.checkpoint=a", "collect.steps=7"])) == run_id(
        compose(["task=export", "export.checkpoint=a"])
    )


def test_means_of_a_training_name_no_other_run_folder() -> None:
    """What is advised where memory runs out goes on with the same training."""
    means = ["training.num_workers=0", "training.checkpoint_minutes=5", "training.cuda_graphs=false"]
    assert run_id(compose()) == run_id(compose(means)) != run_id(compose(["training.validations=3"]))


@pytest.mark.parametrize("override", ["training_data=frames", "data=void"])
def test_recorded_frames_are_refused_where_nothing_takes_them(override: str) -> None:
    with pytest.raises(DeuxError, match=rf"{override} has no effect with task=experiment, .* task=train .*does\."):
        check([override])
    check([override, "task=train", "training_data=frames"])


def test_how_jobs_are_handed_out_names_no_other_run_folder() -> None:
    plain, other = compose(), compose(["collect.processes=3", "collect.executor=ray", "collect.executor_options.a=1"])
    assert run_id(plain) == run_id(other) != run_id(compose(["collect.batch_size=3"]))
    assert sections_of(plain).identity == sections_of(other).identity
    assert other.collect.processes == 3


@pytest.mark.parametrize("seed", [-1, 2**32, 1.5, "one", None])
def test_the_seed_is_a_whole_number(seed: object) -> None:
    cfg = compose()
    cfg.seed = seed
    with pytest.raises(DeuxError, match=r"^seed is .*: it must be a whole number from 0 to"):
        _ = sections_of(cfg).seed


def test_options_of_plugins_and_constructors_need_no_plus() -> None:
    overrides = [f"{node}.anything=3" for node in OPEN_NODES if node != "objective"]
    cfg = compose([*overrides, "objective.sparse_depth.weight=0.5", "objective.sparse_depth.anything=3"])
    assert all(OmegaConf.select(cfg, node).anything == 3 for node in OPEN_NODES if node != "objective")
    assert cfg.objective == {"sparse_depth": {"weight": 0.5, "anything": 3}}


def test_a_model_may_bring_training_settings_of_its_own() -> None:
    rates = [compose([f"model={name}"]).training.learning_rate for name in ("kbnet", "voiced")]
    assert rates[0] == compose().training.learning_rate > rates[1]
    assert compose(["model=voiced", "training.learning_rate=0.01"]).training.learning_rate == 0.01
    assert compose(["experiment=published_voiced"]).training.learning_rate == 1e-4
    assert compose(["model=scaffnet"]).training.batch_size == compose().foundation.batch_size == 8


def test_an_experiment_overrides_the_file_and_the_command_line_overrides_the_experiment() -> None:
    assert compose(["experiment=debug"]).collect.steps < compose().collect.steps
    assert compose(["experiment=debug", "collect.steps=7"]).collect.steps == 7


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("model=kbnt", "there is no depth model called 'kbnt': did you mean kbnet?"),
        ("explore=duex", "there is no explorer called 'duex': did you mean deux?"),
        ("scenes=apartment", "there is no source of scenes called 'apartment': did you mean apartments?"),
        ("experiment=debg", "there is no experiment called 'debg': did you mean debug?"),
        ("objective.sparse=1", "there is no loss term called 'sparse': did you mean sparse_depth?"),
        ("explore.name=duex", "there is no explorer called 'duex': did you mean deux?"),
        ("collect.step=3", "there is no option collect.step: did you mean steps?"),
        ("colect.steps=3", "there is no option colect: did you mean collect"),
        ("collect={stps: 3}", "there is no option collect.stps: did you mean steps?"),
        ("collect.steps.more=3", "there is no option collect.steps.more: collect.steps is a single value."),
        ("seed", "'seed' is not of the form option=value."),
        ("+seed=1", "+seed= adds an option, but seed exists: write seed=, without the plus sign."),
        ("+camera.width=64", "+camera.width= adds an option, but camera.width exists: write camera.width=, without"),
        ("+experiment=debug", "+experiment= adds an option, but experiment exists: write experiment=, without the"),
        ("+model=kbnet", "+model= adds an option, but model exists: write model=, without the plus sign."),
        (
            "hydra.launcher.n_jobs=2",
            "there is no option hydra.launcher.n_jobs: the launcher basic has no options; choose another one",
        ),
        (
            "seed_model.checkpoint=a=b.ckpt",
            """the value of seed_model.checkpoint needs quotes of its own, as in 'seed_model.checkpoint=""",
        ),
        ("explore=random,", "the value of explore ends with a comma: write several values without spaces, explore="),
        (
            "model=kbnet,voiced",
            "model cannot be kbnet,voiced: add -m to run each in turn, or write model=[kbnet,voiced]",
        ),
    ],
)
def test_mistakes_are_reported_in_one_sentence(override: str, sentence: str) -> None:
    with pytest.raises(DeuxError) as caught:
        compose([override])
    assert str(caught.value).startswith(sentence)
    assert "\n" not in str(caught.value)


def test_the_run_folder_is_named_by_everything_but_the_paths() -> None:
    names = {
        run_id(compose(overrides))
        for overrides in (
            ["task=train", "seed=3"],
            ["seed=3", "task=train", "paths.outputs=elsewhere"],
        )
    }
    assert len(names) == 1
    assert names.pop().startswith("kbnet-deux-")
    variations: tuple[list[str], ...] = (
        [],
        ["seed=1"],
        ["model.min_depth=0.2"],
        ["robot.radius=0.2"],
        ["trainer.max_epochs=1"],
    )
    assert len({run_id(compose(overrides)) for overrides in variations}) == len(variations)


@pytest.mark.parametrize(
    ("task", "option"),
    [("evaluate", "evaluation.checkpoint"), ("predict", "predict.checkpoint"), ("export", "export.checkpoint")],
)
def test_a_run_of_a_given_model_is_named_by_its_task(task: str, option: str) -> None:
    names = {run_id(compose([f"task={task}", f"{option}={checkpoint}"])) for checkpoint in ("a", "b")}
    assert len(names) == 2
    assert all(name.startswith(f"{task}-") and name.count("-") == 1 for name in names)


def test_a_package_can_bring_yaml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh_registry: None) -> None:
    entry_points = "[deux.explorers]\nspiral = spirals:Spiral\n[deux.conf]\nspirals = spirals.conf\n"
    yaml = {
        "__init__.py": "",
        "explore/spiral.yaml": "name: spiral\npitch: 2\n",
        "scenes/mine.yaml": "name: apartments\ntest: 3\n",
    }
    files = {f"spirals/conf/{path}": content for path, content in yaml.items()}
    install(tmp_path, "spirals", entry_points, {"spirals/__init__.py": "", **files})
    monkeypatch.syspath_prepend(str(tmp_path))
    cfg = compose(["explore=spiral", "explore.turns=3", "scenes=mine"])
    assert cfg.explore == {"name": "spiral", "pitch": 2, "turns": 3}
    assert (cfg.scenes.name, cfg.scenes.test) == ("apartments", 3)


def test_a_package_whose_yaml_cannot_be_found_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, fresh_registry: None
) -> None:
    install(
        tmp_path,
        "broken-yaml",
        "[deux.conf]\nbroken = broken_yaml.conf\n",
        {"broken_yaml.py": "raise OSError"},
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    with caplog.at_level(logging.WARNING):
        assert compose().model.name == "kbnet"
    assert "the configuration of broken-yaml is left out" in caplog.text


def test_a_checkout_finds_its_own_folder_where_the_installed_one_is_not_importable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import deux

    monkeypatch.setitem(sys.modules, "deux.conf", None)
    assert config_folder() == Path(deux.__file__).resolve().parents[1] / "conf"


def test_outside_a_job_there_is_no_sweep_and_paths_start_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert not in_sweep()
    assert user_path("a/b.ckpt") == tmp_path / "a" / "b.ckpt"
    assert user_path("/a/b.ckpt") == Path("/a/b.ckpt")


def test_a_plugin_that_was_registered_by_hand_composes(fresh_registry: None) -> None:
    registry().register("explorers", "resting", Resting)
    cfg = compose(["explore=resting", "explore.patience=2"])
    assert registry().create("explorers", cfg.explore.name, cfg.explore).patience == 2.0


def test_composing_returns_plain_nodes_that_stay_checked() -> None:
    cfg = compose()
    assert isinstance(cfg, DictConfig)
    assert OmegaConf.is_struct(cfg.collect)
    assert not OmegaConf.is_struct(cfg.model)


@pytest.fixture
def second_random(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second package with an explorer called `random`."""
    second = Plugin("random", "explorers", "other-package", "2.0", "other:Explorer", lambda: None)
    monkeypatch.setitem(registry()._plugins, "explorers", [*registry().plugins("explorers"), second])


@pytest.mark.usefixtures("second_random")
def test_a_name_of_two_packages_is_an_error_where_it_is_asked_for_and_nowhere_else() -> None:
    assert compose(["explore=frontier"]).seed_model.explore == "random"
    sections = sections_of(compose(["task=collect", "explore=deux", "scenes.train=1", "scenes.validation=0"]))
    datasets = Datasets(sections, ["train"])
    assert SeedModel(sections, datasets, Training(sections, datasets, 1)).settings.checkpoint == "kbnet-indoor"
    advice = r"of deux .* and other-package 2\.0 .*: give that of other-package another name, or uninstall other-p"
    for asked in (["explore=random"], ["explore=deux", "seed_model.checkpoint=null"], ["task=compare_explorers"]):
        with pytest.raises(DeuxError, match=f"^the name 'random' belongs to 2 explorers, {advice}"):
            compose(asked)
    with pytest.raises(DeuxError, match="there is no explorer called 'rndom': did you mean random"):
        compose(["seed_model.explore=rndom"])
