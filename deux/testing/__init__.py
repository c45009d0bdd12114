"""Conformance test suites for all kinds of plugins, and the simulated worlds that they use.

Pytest rewrites the assertions of this package as in test files. PYTEST_DONT_REWRITE excludes this module, which is
already imported when the package is registered, and avoids a warning.
"""

from contextlib import suppress

with suppress(ModuleNotFoundError):  # the worlds can be used without pytest
    import pytest

    pytest.register_assert_rewrite("deux.testing")
