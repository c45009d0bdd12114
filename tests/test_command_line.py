"""The real command, in processes of its own and within this one, with the task `train` replaced by a stub."""

import json
import os
import subprocess
import sys
import types
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from deux.__main__ import _release_frames
from deux.errors import DeuxError
from deux.registry import registry

RUN = """
import json, os, signal
from pathlib import Path

def run(cfg):
    from deux.configuration import in_sweep, run_folder, user_path
    from deux.errors import DeuxError
    errors = {1: DeuxError("the seed is 1."), 2: ZeroDivisionError("a fault"), 3: KeyboardInterrupt()}
    if cfg.seed in errors:
        raise errors[cfg.seed]
    if cfg.seed in (6, 7):
        try:
            raise KeyboardInterrupt
        finally:
            raise {6: RuntimeError("an unfinished file cannot be closed"), 7: DeuxError("a lock was lost.")}[cfg.seed]
    if cfg.seed == 5:
        os.kill(os.getpid(), signal.SIGTERM)
    if cfg.seed == 4:
        import numba
    facts = {"explore": cfg.explore.name, "sweep": in_sweep(), "folder": str(run_folder()), "path": str(user_path("x"))}
    Path(run_folder() / "facts.json").write_text(json.dumps(facts))
"""

STUB = f"""
{RUN}
import sys, types
task = types.ModuleType("deux.tasks.train")
task.run = run
sys.modules["deux.tasks.train"] = task
from deux.__main__ import main
sys.exit(main())
"""


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


def stubbed(folder: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
    return command(folder, "-c", STUB, *overrides, "task=train")


@pytest.fixture
def here(
    command_line: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command inside this process, in the test's folder: here(*overrides)."""
    monkeypatch.chdir(tmp_path)
    task = types.ModuleType("deux.tasks.train")
    exec(RUN, task.__dict__)
    monkeypatch.setitem(sys.modules, "deux.tasks.train", task)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        capfd.readouterr()
        code = command_line(*arguments)
        told = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, code, told.out, told.err)

    return run


SLOW_PACKAGES = {"torch", "lightning", "torchmetrics", "numpy", "scipy", "numba", "cv2", "matplotlib", "deux_plugins"}


def imported_packages(report: str) -> set[str]:
    """The packages in what `python -X importtime` writes."""
    return {line.rpartition("|")[2].strip().split(".")[0] for line in report.splitlines() if "|" in line}


def facts(folder: Path, pattern: str) -> dict[str, object]:
    (path,) = folder.glob(pattern)
    return json.loads(path.read_text())


def test_help_tells_what_there_is_without_importing_torch(tmp_path: Path) -> None:
    result = command(tmp_path, "-X", "importtime", "-m", "deux", "--help")
    assert result.returncode == 0
    for expected in (
        "usage: python -m deux",
        "experiment        collect, train",
        f"explore: {', '.join(sorted([*registry().names('explorers'), 'deux_paper']))}",
        f"model: {', '.join(registry().names('depth_models'))}",
        "scenes: apartments, ",
        "experiment: adaptation, debug",
        "sparse_depth",
        f"\n{', '.join(registry().names('rewards'))}\n",
        "docs/plugins.md",
        "batch_size:",
    ):
        assert expected in result.stdout
    assert "hydra" in imported_packages(result.stderr)
    assert not imported_packages(result.stderr) & SLOW_PACKAGES
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ("-m", "deux", "experiment=debug", "--cfg", "job"),
        ("-m", "deux", "modl=kbnet"),
        ("-m", "deux.plugins"),
        ("-m", "deux.doctor", "--help"),
        ("-m", "deux.bench", "--help"),
        ("-c", "import deux"),
        ("-c", "from deux.configuration import compose; compose(['experiment=debug', 'model=voiced'])"),
    ],
    ids=" ".join,
)
def test_what_only_reads_the_configuration_imports_no_library_that_takes_seconds(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    result = command(tmp_path, "-X", "importtime", *arguments)
    assert result.returncode == (1 if "modl=kbnet" in arguments else 0)
    assert "deux" in imported_packages(result.stderr)
    assert not imported_packages(result.stderr) & SLOW_PACKAGES


TRAINING_PACKAGES = {"lightning", "torchmetrics", "torchvision", "matplotlib", "stable_baselines3"}
"""Seconds of imports, for what comes minutes after a task's first line."""


IN_TURN = """
import importlib, sys
from deux.__main__ import main

def run(*arguments):
    sys.argv = ["deux", "experiment=debug", *arguments]
    try:
        code = main()
    except SystemExit as left:
        code = left.code
    print("exit code", code, "next", file=sys.stderr)

run("model.foo=1")
run("explore=random", "training.steps=0")
for name in ("train", "collect", "evaluate", "predict", "export"):
    importlib.import_module(f"deux.tasks.{name}")
"""
"""What is imported once stays so: each command must import no more than the next one may."""


def test_tasks_say_their_first_line_before_they_import_what_trains(tmp_path: Path) -> None:
    result = command(tmp_path, "-X", "importtime", "-c", IN_TURN)
    assert result.returncode == 0
    options, steps, tasks = result.stderr.split("next\n")

    def said(part: str) -> list[str]:
        return [line for line in part.splitlines() if not line.startswith("import time:")]

    mistake, code = said(options)
    assert mistake.startswith("deux: model.foo is not an option of KBNet: there is: ")
    assert code == "exit code 1 "
    assert "deux.tasks.experiment" not in options
    assert not imported_packages(options) & (TRAINING_PACKAGES | {"numba", "kornia", "scipy"})
    assert said(steps) == ["deux: training.steps is 0: it must be at least 1.", "exit code 1 "]
    assert not imported_packages(steps) & TRAINING_PACKAGES
    assert said(tasks) == []
    assert "deux.deployment.onnx_export" in tasks
    assert not imported_packages(tasks) & (TRAINING_PACKAGES - {"matplotlib"})  # predict draws at once


Here = Callable[..., subprocess.CompletedProcess[str]]


def test_the_same_command_finds_the_same_run_folder(tmp_path: Path, here: Here) -> None:
    """First in a process whose working folder holds one of the name of a library."""
    (tmp_path / "coverage").mkdir()  # numba imports a library of that name, if there is one
    for run in (partial(stubbed, tmp_path), partial(here, "task=train")):
        result = run("explore=random", "seed=4")
        assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    known = facts(tmp_path, "outputs/runs/kbnet-random-*/facts.json")
    (folder,) = tmp_path.glob("outputs/runs/*")
    assert known == {"explore": "random", "sweep": False, "folder": str(folder), "path": str(tmp_path / "x")}
    assert (folder / "deux.log").is_file()
    assert "name: random" in (folder / ".hydra" / "config.yaml").read_text()


def test_a_mistake_of_the_users_is_one_sentence_without_a_stack_trace(tmp_path: Path, here: Here) -> None:
    result = here("seed=1", "task=train")
    assert (result.returncode, result.stdout, result.stderr) == (1, "", "deux: the seed is 1.\n")
    (log,) = tmp_path.glob("outputs/runs/*/deux.log")
    assert "Traceback" in log.read_text()


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("task=trian", "deux: there is no task called 'trian': did you mean train?"),
        ("model=kbnt", "deux: there is no depth model called 'kbnt': did you mean kbnet?"),
        (
            "task=${nowhere}",
            "deux: task refers by ${...} to an option that is not there: where the text itself is meant, write",
        ),
    ],
)
def test_a_mistake_in_the_configuration_is_one_sentence_too(tmp_path: Path, override: str, sentence: str) -> None:
    result = command(tmp_path, "-m", "deux", override)
    assert result.returncode == 1
    assert result.stderr.startswith(sentence)
    assert result.stderr.count("\n") == 1


def test_a_fault_of_the_program_keeps_its_stack_trace(here: Here) -> None:
    result = here("seed=2", "task=train")
    assert result.returncode == 1
    assert "Traceback" in result.stderr
    assert "ZeroDivisionError: a fault" in result.stderr


@pytest.mark.parametrize("seed", [3, 6], ids=["interrupt", "its clean-up fails"])
def test_an_interrupted_run_ends_with_130(here: Here, seed: int) -> None:
    result = here(f"seed={seed}", "task=train")
    assert result.returncode == 130
    assert result.stderr == "deux: interrupted; the same command goes on from here.\n"


def test_what_an_interrupted_run_reports_itself_is_kept(here: Here) -> None:
    result = here("seed=7", "task=train")
    assert (result.returncode, result.stderr) == (1, "deux: a lock was lost.\n")


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("random_seed=1", "there is no option random_seed: it is now called seed."),
        ("+seed.steps=1", "there is no option seed.steps: it is now called seed_model.steps."),
        ("image=a${x}.png", "there is no option image: it is now called predict.image."),
        ("predict.image=a${x}.png", "predict.image refers by ${...} to an option that is not there: where the text"),
        ("callbacks=none", "callbacks=none is now callbacks=[], a list of callbacks without any."),
        ("scenes.train=[my house (1).ply]", "the items of scenes.train need quotes of their own: write 'scenes.train="),
        ('scenes.train="[a.ply,b c.ply]"', "the quotes around the whole list make scenes.train a single text: write "),
        (
            "paths.outputs=1e3",
            "paths.outputs must be text, but 1e3 would not be read as text: write 'paths.outputs=\"1e3\"'.",
        ),
        ("training_data=-inf", "training_data must be text, but -inf would not be read as text"),
        ("callbacks=[nothing]", "there is no callback called 'nothing': there is: active_collection"),
    ],
)
def test_values_and_names_that_do_not_work_are_reported_with_what_would(
    here: Here, argument: str, sentence: str
) -> None:
    result = here("task=predict", argument)
    assert result.returncode == 1
    assert result.stderr.startswith(f"deux: {sentence}")
    assert result.stderr.count("\n") == 1


def test_a_folder_may_have_a_name_that_reads_as_a_number(tmp_path: Path, here: Here) -> None:
    assert here("paths.outputs=2024_01_15", "task=train").returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == ["2024_01_15"]


def test_a_sweep_goes_on_after_a_job_that_fails_and_ends_with_1(tmp_path: Path, here: Here) -> None:
    result = here("seed=1,0", "-m", "explore=random,deux", "task=train")  # the flag may stand anywhere
    assert result.returncode == 1
    assert "deux: [seed=1 explore=random task=train] the seed is 1.\n" in result.stderr
    assert "deux: [seed=1 explore=deux task=train] the seed is 1.\n" in result.stderr
    assert result.stderr.endswith("deux: 2 of the sweep's 4 jobs failed, as reported above.\n")
    assert "Traceback" not in result.stderr
    assert len(list(tmp_path.glob("outputs/sweeps/*/*/deux.log"))) == 4
    assert facts(tmp_path, "outputs/sweeps/*/kbnet-deux-*/facts.json")["sweep"] is True


def test_a_sweep_that_cannot_be_composed_starts_no_job(tmp_path: Path, here: Here) -> None:
    result = here("-m", "explore=random,nowhere", "task=train")
    assert result.returncode == 1
    assert result.stderr.startswith("deux: there is no explorer called 'nowhere'")
    assert not list(tmp_path.glob("outputs/**/facts.json"))


def test_an_end_by_sigterm_is_reported_and_has_its_exit_code(tmp_path: Path) -> None:
    result = stubbed(tmp_path, "seed=5")
    assert result.returncode == 143
    assert result.stderr == "deux: ended by SIGTERM; the same command goes on from here.\n"


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("paths.outputs=loop", "cannot be used: Too many levels of symbolic links."),
        (f"paths.outputs={'a' * 300}", "cannot be used: File name too long."),
        ("paths.outputs=file", "cannot be written: Not a directory."),
        ("paths.outputs={a: 1}", "paths.outputs must be the path of a folder, but is {'a': 1}."),
        ("hydra.run.dir=${nothing}", "hydra.run.dir refers by ${...} to an option that is not there"),
        ("explore=5", "explore is chosen by a name, but 5 is not a name."),
        ("explore=[[1]]", "the configuration cannot be composed: "),
        ("seed=1" + 5000 * "0", "the configuration cannot be composed: Exceeds the limit"),
        ("camera=5", "camera holds options by name, as in camera.<option>=<value>, but is 5."),
        ("~camera", "the section camera was removed from the configuration, but the task reads it: keep it."),
        ("pose=\x1b[31m", "pose"),
    ],
)
def test_what_fails_before_a_job_begins_is_one_sentence(
    tmp_path: Path, here: Here, override: str, sentence: str
) -> None:
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "file").touch()
    read = override.endswith(("camera", "camera=5")) or override.startswith("pose")
    result = here("task=train" if read else "task=report", override)
    told = result.stderr
    assert result.returncode == 1
    assert told.startswith("deux: ")
    assert told.count("\n") == 1
    assert sentence in told
    assert "\x1b" not in told


@pytest.mark.parametrize(
    ("folder", "environment", "sentence"),
    [
        ("${oc.env:HOME}", {}, "reads as a reference to an option: start the command in another one."),
        ("gone", {}, "the working folder cannot be used, No such file or directory: start the command in another one."),
        ("here", {"LC_ALL": "C", "PYTHONUTF8": "0"}, "this Python takes file names and texts for ascii: start it with"),
    ],
)
def test_where_no_command_can_be_started(
    tmp_path: Path, folder: str, environment: dict[str, str], sentence: str
) -> None:
    (tmp_path / folder).mkdir()
    leave = "os.rmdir(os.getcwd()); " if folder == "gone" else ""
    script = f"import os, runpy; {leave}runpy.run_module('deux', run_name='__main__')"
    result = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path / folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert sentence in result.stderr
    assert result.stderr.count("\n") == 1


def test_objects_that_an_error_left_half_made_do_not_complain_after_its_sentence(monkeypatch) -> None:
    class HalfMade:
        def __del__(self) -> None:
            raise AttributeError

    def fail() -> None:
        half_made = HalfMade()
        left.append(weakref.ref(half_made))
        raise DeuxError("it cannot be made")

    complaints: list[object] = []
    left: list[weakref.ref[HalfMade]] = []
    monkeypatch.setattr(sys, "unraisablehook", complaints.append)
    with pytest.raises(DeuxError) as raised:
        fail()
    assert left[0]() is not None
    _release_frames(raised.value)
    assert left[0]() is None
    assert complaints == []
