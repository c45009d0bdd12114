"""A writer of glTF files; makes its module `gltf_writer` importable by its name."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from gltf_writer import GltfWriter


@pytest.fixture
def gltf(tmp_path: Path) -> GltfWriter:
    """A writer of glTF files into the test's folder."""
    return GltfWriter(tmp_path)
