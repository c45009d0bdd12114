"""What a wheel holds, and that it works away from the checkout."""

import json
import os
import re
import shutil
import site
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import deux

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


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A folder with a new environment, `.venv`, that sees the packages of this one but not deux itself."""
    subprocess.run([sys.executable, "-m", "venv", tmp_path / ".venv"], check=True, timeout=240)
    (packages,) = (tmp_path / ".venv" / "lib").glob("python*/site-packages")
    shutil.rmtree(packages / "setuptools", ignore_errors=True)  # an old one comes with Python 3.11
    for old in packages.glob("setuptools-*"):
        shutil.rmtree(old)
    # A folder that a .pth file adds reads no .pth files of its own: an editable deux in it is not found.
    linked = [folder for folder in sys.path if folder in site.getsitepackages() or "site-packages" in folder]
    (packages / "packages_of_the_tests.pth").write_text("\n".join(linked) + "\n")
    return tmp_path


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_wheel_and_sdist_are_built_and_the_experiment_runs_elsewhere(elsewhere: Path) -> None:
    source, built = elsewhere / "source", elsewhere / "dist"
    ignored = shutil.ignore_patterns("__pycache__", ".*", "outputs", "site", "*.egg-info", "tests", "docs", "build")
    shutil.copytree(ROOT, source, ignore=ignored)
    pytest.importorskip("build", reason="the package build is not installed")
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", built, source], check=True, timeout=300
    )
    (sdist,), (wheel,) = built.glob("*.tar.gz"), built.glob("*.whl")  # the wheel is made from the sdist
    with tarfile.open(sdist) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    assert {"conf/config.yaml", "plugins/explorers/weights/coverage.safetensors", "LICENSE", "README.md"} <= held
    shutil.rmtree(source)
    python = elsewhere / ".venv" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--no-deps", "--no-index", "--disable-pip-version-check", wheel]
    subprocess.run(install, check=True, timeout=240)
    work = elsewhere / "work"
    work.mkdir()
    where = [python, "-c", "import deux; print(deux.__file__)"]
    found = subprocess.run(where, cwd=work, capture_output=True, text=True, check=True, timeout=120).stdout
    assert Path(found.strip()).is_relative_to(elsewhere)
    command = [python, "-m", "deux", "experiment=debug", "trainer.accelerator=cpu"]
    result = subprocess.run(command, cwd=work, capture_output=True, text=True, timeout=800, check=False)
    assert result.returncode == 0, result.stderr
    (results,) = work.glob("outputs/runs/kbnet-deux-*/results.json")
    assert json.loads(results.read_text())["model"] == "kbnet"


def pins() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return dict(line.split("==") for line in lines if not line.startswith("#"))


def test_the_constraints_pin_every_dependency_within_its_bounds() -> None:
    project = PROJECT["project"]
    extras = ("compressed", "export", "gl", "hub", "docs")
    needed = project["dependencies"] + [text for extra in extras for text in project["optional-dependencies"][extra]]
    for requirement in map(Requirement, needed):
        pinned = pins()[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(pinned, prereleases=True), requirement


def test_the_constraints_hold_public_versions_and_no_paths() -> None:
    assert all(re.fullmatch(r"[a-z0-9-]+", name) for name in pins())
    assert all(re.fullmatch(r"\d+(\.\d+)*((a|b|rc|\.post|\.dev)\d+)?", version) for version in pins().values())


def instructions() -> list[tuple[str, str]]:
    """The lines of the Dockerfile: the instruction and what stands behind it."""
    text = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(line.split(maxsplit=1)[0], line.split(maxsplit=1)[1]) for line in lines]


def test_the_dockerfile_sets_up_as_readme_does() -> None:
    (setup,) = re.findall(r"^ {4}(.*) && \.venv/bin/python -m deux model=", (ROOT / "README.md").read_text(), re.M)
    commands = [
        re.sub(r" --no-cache-dir| -c constraints.txt", "", text) for name, text in instructions() if name == "RUN"
    ]
    for command in setup.split(" && "):
        assert command.replace("-e .", '-e ".[gl]"') in commands
    libraries = re.search(r"apt-get install (.*?)`", (ROOT / "README.md").read_text())
    assert libraries is not None
    assert libraries[1] in commands[0]


def test_the_dockerfile_copies_what_the_package_needs() -> None:
    copied = {word for name, text in instructions() if name == "COPY" for word in text.split()[:-1]}
    tops = set(PROJECT["tool"]["setuptools"]["package-dir"].values()) | {"deux"}
    assert tops | {"pyproject.toml", "README.md", "LICENSE", "constraints.txt"} == copied
    allowed = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    assert copied == allowed


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_dockerfile_is_a_script_that_works(elsewhere: Path) -> None:
    """Its RUN lines, but for the system's packages and the downloads: pip takes what is installed here."""
    offline = {"PIP_NO_DEPS": "1", "PIP_NO_INDEX": "1", "PIP_NO_BUILD_ISOLATION": "0", "TORCH": "cuda"}
    environment = {**os.environ, **offline, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    for name, text in instructions():
        if name == "COPY":
            *sources, target = text.split()
            for one in sources:
                path = elsewhere / target / one if target.startswith(".") else elsewhere / target
                if (ROOT / one).is_dir():
                    shutil.copytree(ROOT / one, path, ignore=shutil.ignore_patterns("__pycache__"))
                else:
                    shutil.copy(ROOT / one, path)
        elif name == "RUN" and "apt-get" not in text and "-m venv" not in text:
            command = ["bash", "-euo", "pipefail", "-c", text]
            result = subprocess.run(
                command, cwd=elsewhere, env=environment, capture_output=True, text=True, timeout=800, check=False
            )
            assert result.returncode == 0, f"{text}\n{result.stdout}\n{result.stderr}"
    assert dict(instructions())["ENTRYPOINT"] == '["python", "-m", "deux"]'


def forms() -> Iterator[Path]:
    yield from (path for path in (ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config")


def test_reports_of_faults_ask_for_the_output_of_the_doctor() -> None:
    asking = {path.stem for path in forms() if "python -m deux.doctor" in path.read_text()}
    assert asking == {"fault", "installation"}
    for path in forms():
        form = yaml.safe_load(path.read_text())
        assert {"name", "description", "body"} <= set(form)


def test_the_workflow_calls_what_is_there_on_every_python_that_is_promised() -> None:
    (job,) = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"].values()
    commands = [step["run"] for step in job["steps"] if "run" in step]
    assert ".ci/run" in commands
    for command in commands:
        if command.startswith("."):
            assert os.access(ROOT / command, os.X_OK)
    least = PROJECT["project"]["requires-python"].removeprefix(">=")
    assert job["strategy"]["matrix"]["python"][0] == least


def test_the_citation_names_the_paper_and_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert str(citation["version"]) == PROJECT["project"]["version"]
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == ["Chancán", "Wong", "Abraham"]
    assert paper["title"] in " ".join((ROOT / "README.md").read_text().split())


def test_completion_offers_what_the_package_offers_to_users() -> None:
    assert dir(deux) == ["__version__", "available", "from_pretrained", "load", "load_published", "predict"]
