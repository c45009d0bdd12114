"""The module search path of `python -m deux`."""

import os
import sys
from pathlib import Path


def leave_out_working_folder() -> None:
    """Remove the working folder, which `python -m` puts first, from the module search path.

    A folder in it may have the name of an optional dependency that is not installed, such as `coverage` of numba. A
    checkout of deux is moved to the end of the path instead, since the processes of a run import deux from it.
    """
    here = Path.cwd()
    if sys.path and sys.path[0] in ("", os.fspath(here)):
        del sys.path[0]
        if Path(__file__).resolve().parents[1] == here.resolve():
            sys.path.append(os.fspath(here))
