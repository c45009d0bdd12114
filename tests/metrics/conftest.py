"""Makes the helper module `void_layout`, which writes datasets, importable by its name."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("data", "collection")]
