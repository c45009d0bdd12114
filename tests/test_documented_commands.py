"""Every command that README and docs show is composed: its options are there and its plugins are installed."""

import re
import shlex
from pathlib import Path

import pytest
from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher

from deux.configuration import compose

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *(page for page in ROOT.glob("docs/*.md") if page.name != "plugins.md")]
"""All but the page whose commands need the example package, which tests/test_example_package.py installs."""

LAUNCHERS = {"joblib": "joblib", "submitit_local": "submitit", "submitit_slurm": "submitit", "ray": "ray"}
"""The package behind each launcher of sweeps; some are installed only with an extra."""


def commands() -> list[tuple[str, ...]]:
    """The options of each command, of a sweep those of its first run."""
    found = []
    for page in PAGES:
        for line in page.read_text().replace("\\\n", " ").splitlines():
            if match := re.match(r" {4}(?:.* && )?\S*python -m deux (.+)", line):
                words = shlex.split(match[1], comments=True)
                options = [word for word in words if "=" in word and not word.startswith("-")]
                found.append(tuple(_first(option) if "-m" in words else option for option in options))
    return sorted({options for options in found if options})


def _first(option: str) -> str:
    """The option with the first of a sweep's values, which may be a list."""
    return re.sub(r"(=\[.*?\]|=[^,]*),.*", r"\1", option)


def test_there_are_commands():
    assert len(commands()) > 30
    assert ("model=kbnet", "explore=deux") in commands()


@pytest.mark.parametrize("options", commands(), ids=" ".join)
def test_the_command_is_composed(options):
    launchers = Plugins.instance().discover(Launcher)
    for option in options:
        group, _, name = option.partition("=")
        if group == "hydra/launcher" and not any(LAUNCHERS[name] in plugin.__module__ for plugin in launchers):
            pytest.skip(f"the launcher {name} is not installed")
    assert compose(options).task
