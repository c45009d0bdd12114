"""Makes the helper modules `hostile` and `gltf_writer` importable by their names."""

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "mesh_files"))

from hostile import Campaign


@pytest.fixture
def campaign(request: pytest.FixtureRequest, tmp_path: Path) -> Campaign:
    """Runs cases in the test's folder: some of them, or all in a test that is marked as slow."""
    return Campaign(tmp_path, most=None if request.node.get_closest_marker("slow") else 120)


@pytest.fixture
def special_files(tmp_path: Path):
    """Make what is no file, once for each suffix: a pipe, a device without end, a folder, a link to itself."""

    def make(*suffixes: str) -> list[Path]:
        made = []
        for suffix in suffixes:
            pipe, endless, folder, itself, gone = (
                tmp_path / f"{name}{suffix}" for name in ("pipe", "endless", "folder", "itself", "gone")
            )
            os.mkfifo(pipe)
            endless.symlink_to("/dev/zero")
            folder.mkdir()
            itself.symlink_to(itself)
            made += [pipe, endless, folder, itself, gone, tmp_path / f"{'n' * 300}{suffix}", tmp_path / f"\0{suffix}"]
        return made

    return make
