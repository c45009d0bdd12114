"""The documentation site: every page is in the menu, no link leads nowhere, and it builds without a warning."""

import ast
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(path for path in (ROOT / "docs").rglob("*.md") if not {"examples", "reference"} & set(path.parts))
GENERATED = {"reference/configuration.md"}


def menu() -> list[str]:
    """The pages that mkdocs.yml names."""
    found = []

    def walk(node) -> None:
        if isinstance(node, str):
            found.append(node)
        else:
            for child in node.values() if isinstance(node, dict) else node:
                walk(child)

    walk(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    return found


def test_every_page_is_in_the_menu_once():
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in PAGES}
    assert sorted(menu()) == sorted(pages | GENERATED)


@pytest.mark.parametrize(
    "page", [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda path: path.relative_to(ROOT).as_posix()
)
def test_links_and_pictures_of_a_page_are_there(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if "://" not in target and not target.endswith("reference/configuration.md"):
            assert (page.parent / target).exists(), target


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as Python-Markdown makes them of plain text."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S), re.M)
    plain = (re.sub(r"[^\w\s-]", "", heading).strip().lower() for heading in headings)
    return {re.sub(r"[-\s]+", "-", heading) for heading in plain}


@pytest.mark.parametrize(
    "page",
    [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "docs" / "reference.py"],
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)
def test_links_lead_to_headings_that_are_there(page):
    folder = ROOT / "docs" / "reference" if page.name == "reference.py" else page.parent
    for target, anchor in re.findall(r"\]\(([^)#\s]*)#([^)\s]+)\)", page.read_text()):
        linked = Path(os.path.normpath(folder / target)) if target else page
        if "://" not in target and linked.suffix == ".md" and linked.stem != "configuration":
            assert anchor in anchors(linked), f"{target}#{anchor}"


@pytest.mark.slow  # .ci/run builds it on its own
def test_the_site_is_built_strictly(tmp_path):
    if find_spec("zensical") is None or find_spec("mkdocstrings") is None:
        pytest.skip("the extra docs is not installed")
    for name in ("deux", "plugins", "conf", "docs", ".ci"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "reference"))
    for name in ("mkdocs.yml", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    result = subprocess.run(
        [tmp_path / ".ci" / "site"],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    for page in menu():
        folder = Path(page).parent if Path(page).stem in ("index", "README") else Path(page).with_suffix("")
        assert (tmp_path / "site" / folder / "index.html").is_file(), page
    assert 'id="deux.deployment.array_prediction.predict_arrays"' in (tmp_path / "site/api/index.html").read_text()
    examples = (tmp_path / "site/plugin-examples/index.html").read_text()
    for path in (ROOT / "docs/examples/deux-example/src/deux_example").glob("[a-z]*.py"):
        assert ast.get_docstring(ast.parse(path.read_text())) in examples, path
