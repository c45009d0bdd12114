import os
from functools import partial
from operator import call, methodcaller

import pytest

from deux.bench.concurrent_processes import at_once


def test_processes_wait_for_each_other() -> None:
    assert at_once(call, methodcaller("__call__"), processes=2, opengl_threads=1) == [None, None]


def test_processes_get_their_number_of_threads_and_this_one_stays_as_it_is() -> None:
    before = dict(os.environ)
    assert at_once(call, partial(os.getenv, "LP_NUM_THREADS"), processes=1, opengl_threads=3) == ["3"]
    assert dict(os.environ) == before


def test_what_goes_wrong_in_a_process_is_raised_here() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        at_once(call, methodcaller("nothing"), processes=2, opengl_threads=1)
