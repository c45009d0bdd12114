"""Limits how long torch's OpenMP threads spin before they sleep, so that they do not slow down busy machines.

At the end of every parallel loop, threads of GNU OpenMP wait for each other. By default, a thread spins for up to
300,000 iterations, some milliseconds, before it sleeps. If another program uses one of the cores, the spinning takes
the time in which the last thread could have run.
"""

import os

SPIN_SETTINGS = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""Environment variables of GNU OpenMP; if one of them is already set, it is respected."""

SPINS = 1000
"""Number of iterations that a thread spins before it sleeps, tens of microseconds.

Most waits within a training step are shorter. Without spinning (OMP_WAIT_POLICY=passive), a small step takes 1.5 times
as long, since waking a thread takes time (measurements in docs/scale.md).
"""


def let_waiting_threads_sleep() -> None:
    """Limit how long torch's threads spin, in this process and its child processes.

    OpenMP reads the environment variable once, so this must be called before torch is imported.
    """
    if not any(name in os.environ for name in SPIN_SETTINGS):
        os.environ["GOMP_SPINCOUNT"] = str(SPINS)
