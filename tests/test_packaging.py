"""What a wheel holds, and that it works away from the checkout."""

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def pip(*arguments: str) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments]
    result = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert result.returncode == 0, result.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel built from a copy of what is packaged, so that no build folder is left in the checkout."""
    source = tmp_path_factory.mktemp("source")
    for folder in ("deux", "plugins", "conf"):
        shutil.copytree(ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source)
    built = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(built), str(source))
    (path,) = built.glob("*.whl")
    return path


def package_name(folder: Path) -> str:
    parts = folder.relative_to(ROOT).parts
    return ".".join(["deux_plugins", *parts[1:]] if parts[0] == "plugins" else parts)


def test_every_folder_with_python_files_is_listed_as_a_package() -> None:
    found = {package_name(path.parent) for top in ("deux", "plugins") for path in (ROOT / top).rglob("*.py")}
    listed = PROJECT["tool"]["setuptools"]["packages"]
    assert len(listed) == len(set(listed))
    assert set(listed) == found | {"deux.conf"}
    assert all((ROOT / top / "__init__.py").is_file() for top in ("deux", "plugins", "conf"))


def test_every_entry_point_leads_to_a_file() -> None:
    for group, entries in PROJECT["project"]["entry-points"].items():
        for name, target in entries.items():
            package, *parts = target.partition(":")[0].split(".")
            path = Path({"deux_plugins": "plugins"}.get(package, package), *parts)
            assert (ROOT / path).with_suffix(".py").is_file() or (ROOT / path / "__init__.py").is_file(), (
                group,
                name,
            )


def test_the_wheel_holds_the_code_the_configuration_the_weights_and_the_marker_of_types(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    code = {
        "/".join([*package_name(path.parent).split("."), path.name])
        for top in ("deux", "plugins")
        for path in (ROOT / top).rglob("*.py")
    }
    weights = {
        f"deux_plugins/{path.relative_to(ROOT / 'plugins')}" for path in (ROOT / "plugins").rglob("*.safetensors")
    }
    yaml = {f"deux/conf/{path.relative_to(ROOT / 'conf').as_posix()}" for path in (ROOT / "conf").rglob("*.yaml")}
    assert code <= held
    assert yaml <= held
    assert weights <= held
    assert {"deux/py.typed", "deux/conf/__init__.py"} <= held
    assert not {name for name in held if name.startswith(("tests/", "conf/", "plugins/"))}


def test_the_installed_wheel_runs_from_another_directory(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    pip("install", "--no-deps", "--no-index", "--target", str(site), str(wheel))
    environment = {**os.environ, "PYTHONPATH": str(site)}

    def python(*arguments: str) -> str:
        command = [sys.executable, *arguments]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=True
        ).stdout

    where = "import deux.configuration as c, deux_plugins as p; print(c.config_folder(), *p.__path__, sep='\\n')"
    assert python("-c", where).splitlines() == [str(site / "deux" / "conf"), str(site / "deux_plugins")]
    assert "scenes: apartments, " in python("-m", "deux", "--help")
