"""Fixtures that all tests share."""

from collections.abc import Callable
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """A function from the name of a folder of reference data to its path; it skips the test where there is none.

    The data is not part of this repository: it lies in `../shared`, as seen from the project's root.
    """

    def folder(name: str) -> Path:
        if not (SHARED / name).is_dir():
            pytest.skip(f"there is no reference data ../shared/{name} beside the project")
        return SHARED / name

    return folder
