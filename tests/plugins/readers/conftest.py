"""Makes the helper modules here, in tests/data and in tests/collection importable by their names."""

import sys
from pathlib import Path

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[2] / "data"),
    str(Path(__file__).parents[2] / "collection"),
]
