import os
import signal
import time
import weakref

import pytest

from deux.interruption import Terminated, interrupt_behind, termination_raised


class Held:
    pass


def wait_after(action):
    action()
    time.sleep(60)


@pytest.mark.parametrize(("number", "kind"), [(signal.SIGTERM, Terminated), (signal.SIGINT, KeyboardInterrupt)])
def test_a_signal_ends_what_is_under_way(number, kind):
    with pytest.raises(kind), termination_raised():
        wait_after(lambda: os.kill(os.getpid(), number))


@pytest.mark.parametrize(("number", "kind"), [(signal.SIGTERM, Terminated), (signal.SIGINT, KeyboardInterrupt)])
def test_a_signal_is_not_lost_where_python_drops_what_is_raised(number, kind):
    def interrupted(_):
        os.kill(os.getpid(), number)
        for _ in range(1000):  # where the handler runs
            pass

    held = [Held()]
    reference = weakref.ref(held[0], interrupted)
    with pytest.raises(kind), termination_raised():
        wait_after(held.clear)
    assert reference() is None


def test_what_was_there_before_is_there_again():
    before = signal.getsignal(signal.SIGTERM)
    with termination_raised():
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before


def test_an_interrupt_is_found_behind_the_errors_of_what_it_interrupted():
    interrupt = Terminated()
    try:
        try:
            raise interrupt
        finally:
            raise ZeroDivisionError
    except ZeroDivisionError as error:
        replaced = RuntimeError("a file is unfinished")
        replaced.__cause__ = error
    assert interrupt_behind(replaced) is interrupt
    assert interrupt_behind(RuntimeError()) is None
