"""Conformance suites for every kind of plugin, and the worlds that they run in.

pytest shows the values in the assertions of these modules, as in those of test files. This one was imported before it
could be told, which it takes for a mistake unless the text says PYTEST_DONT_REWRITE.
"""

from contextlib import suppress

with suppress(ModuleNotFoundError):  # the worlds serve without pytest as well
    import pytest

    pytest.register_assert_rewrite("deux.testing")
