"""Where Python looks for modules when it runs `python -m deux`."""

import os
import sys
from pathlib import Path


def leave_out_working_folder() -> None:
    """Look for no module in the working folder, which `python -m` puts first on the path.

    A folder there may bear the name of a library that is not installed and that another one tries to import (numba
    does so with `coverage`). A checkout of deux itself stays on the path, last: the processes that a run starts import
    deux from there.
    """
    here = Path.cwd()
    if sys.path and sys.path[0] in ("", os.fspath(here)):
        del sys.path[0]
        if Path(__file__).resolve().parents[1] == here.resolve():
            sys.path.append(os.fspath(here))
