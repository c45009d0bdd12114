"""Conformance test suites for all kinds of plugins, and simulated worlds for them.

Their assertions are rewritten by pytest, as in test files. PYTEST_DONT_REWRITE excludes this module, which is imported
before it could be rewritten, and avoids a warning.
"""

from contextlib import suppress

with suppress(ModuleNotFoundError):  # the worlds serve without pytest as well
    import pytest

    pytest.register_assert_rewrite("deux.testing")
