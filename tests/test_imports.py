"""Imports run one way, and `deux` imports no plugin: the contracts under `[tool.importlinter]` in pyproject.toml."""

import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("importlinter", reason="import-linter is not installed: pip install -e '.[dev]'")

ROOT = Path(__file__).resolve().parents[1]
LINT = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", LINT]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)


def test_the_contracts_hold() -> None:
    result = lint(ROOT)
    assert result.returncode == 0, result.stdout
    assert "2 kept, 0 broken" in result.stdout


@pytest.mark.parametrize(
    ("file", "line", "broken"),
    [
        ("geometry/camera.py", "import deux.contracts", "Imports run one way"),
        (
            "scenes/scene.py",
            "from deux.configuration import compose\nimport deux.training",
            "Imports run one way",
        ),
        ("training/__init__.py", "import deux_plugins", "The framework names no plugin"),
    ],
)
def test_the_contracts_notice_an_import_that_breaks_them(tmp_path: Path, file: str, line: str, broken: str) -> None:
    for package, folder in (("deux", "deux"), ("deux_plugins", "plugins")):
        shutil.copytree(ROOT / folder, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    with (tmp_path / "deux" / file).open("a") as stream:
        stream.write(f"\n{line}\n")
    result = lint(tmp_path)
    assert result.returncode == 1, result.stderr
    assert any(broken in row and "BROKEN" in row for row in result.stdout.splitlines())


def test_no_two_modules_share_a_name() -> None:
    names = Counter(path.stem for path in (ROOT / "deux").rglob("*.py") if not path.stem.startswith("__"))
    assert [name for name, count in names.items() if count > 1] == []
