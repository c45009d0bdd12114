"""Makes the helper modules `void_layout` and `toy_world` importable by their names."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("data", "collection")]
