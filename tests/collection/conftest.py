"""Makes the helper module `toy_world` importable by its name, which the processes that the tests start need too."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
