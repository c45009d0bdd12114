"""Every command that README and docs show is composed: its options are there and its plugins are installed.

Those of README that need no data of the reader's own are run, at debug size, under the mark `slow`.
"""

import os
import re
import shlex
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher

from deux.configuration import compose
from deux.plugins import describe_plugin

ROOT = Path(__file__).resolve().parents[1]
OF_EXAMPLES = ("plugins.md", "plugin-examples.md")
"""Pages whose commands need the example packages, which have tests of their own that install them."""

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in ROOT.glob("docs/**/*.md") if page.name not in OF_EXAMPLES and "examples" not in page.parts),
]

LAUNCHERS = {"joblib": "joblib", "submitit_local": "submitit", "submitit_slurm": "submitit", "ray": "ray"}
"""The package behind each launcher of sweeps; some are installed only with an extra."""

LEFT_OUT = ("task=report", "scale=", "--help", "hydra/launcher")
"""Parts of commands that are not run: they need finished runs, or are made for larger sizes."""

OF_THE_READER = re.compile(r"FOLDER|FRAMES|RUN|\.glb|\.jpg|mp3d|hm3d|habitat|void|/data/|<|outputs/")
"""Files and programs of the reader's own."""


def lines(pages: list[Path]) -> list[str]:
    """The commands of pages, with what comes after `python -m `: indented lines, and code within a sentence."""
    found = []
    for page in pages:
        text = page.read_text().replace("\\\n", " ")
        found += re.findall(r"^ {4}(?:.* && )?\S*python -m (deux\b.*)", text, re.M)
        found += re.findall(r"`python -m (deux [^`<]+=[^`<]+)`", text.replace("\n", " "))
    return sorted(set(found))


def commands() -> list[tuple[str, ...]]:
    """The options of each command, of a sweep those of its first run."""
    found = set()
    for line in lines(PAGES):
        name, *words = shlex.split(line, comments=True)
        if name in ("deux", "deux.doctor") and "..." not in words:
            options = [word for word in words if "=" in word and not word.startswith("-")]
            found.add(tuple(_first(option) if "-m" in words else option for option in options))
    return sorted(found - {()})


def _first(option: str) -> str:
    """The option with the first of a sweep's values, which may be a list."""
    return re.sub(r"(=\[.*?\]|=[^,\[]*),.*", r"\1", option)


def test_there_are_commands():
    assert len(commands()) > 60
    assert ("model=kbnet", "explore=deux") in commands()


@pytest.mark.parametrize("options", commands(), ids=" ".join)
def test_the_command_is_composed(options):
    launchers = Plugins.instance().discover(Launcher)
    for option in options:
        group, _, name = option.partition("=")
        if group == "hydra/launcher" and not any(LAUNCHERS[name] in plugin.__module__ for plugin in launchers):
            pytest.skip(f"the launcher {name} is not installed")
    assert compose(options).task


@pytest.mark.parametrize("line", [line for line in lines(PAGES) if re.match(r"deux\.\w", line)])
def test_the_other_programs_take_their_options(line):
    name, *words = shlex.split(line, comments=True)
    if name == "deux.plugins":
        assert all(map(describe_plugin, words))
    else:
        spec = find_spec(name)
        assert spec is not None
        program = f"{name}.__main__" if spec.submodule_search_locations else name
        import_module(program)._parser().parse_args(words)


def runnable() -> list[str]:
    """README's commands that need nothing of the reader's own."""
    found = [line for line in lines([ROOT / "README.md", ROOT / "docs" / "first-experiment.md"]) if line[:5] == "deux "]
    own = [line for line in found if not OF_THE_READER.search(line.partition("#")[0])]
    return [line for line in own if not any(part in line for part in LEFT_OUT)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One working folder for all commands, which share what they collect and train."""
    return tmp_path_factory.mktemp("work")


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("line", runnable())
def test_the_command_runs(line, folder):
    _, *words = shlex.split(line, comments=True)
    small = "scale=debug" if "experiment=" in line else "experiment=debug"
    steps = ["explorer_training.steps=4096", "explorer_training.scenes=2"] if "train_explorer" in line else []
    number = ["scenes.test=2", "compare.steps=8"] if "compare_explorers" in line else []
    command = [sys.executable, "-m", "deux", *words, small, "trainer.accelerator=cpu", *steps, *number]
    result = subprocess.run(
        command, cwd=folder, env=os.environ, capture_output=True, text=True, timeout=880, check=False
    )
    assert result.returncode == 0, result.stderr
