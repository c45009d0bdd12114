"""Limits how long torch's OpenMP threads spin before they sleep, so that they do not slow down busy machines.

At the end of every parallel loop, threads of GNU OpenMP wait for each other. By default, a thread spins for up to
300,000 iterations, some milliseconds, before it sleeps. If another program uses one of the cores, the spinning takes
the time in which the last thread could have run.
"""

import os

SPIN_SETTINGS = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""Environment variables of GNU OpenMP; if one of them is already set, it is respected."""

SPINS = 10_000
"""Number of iterations that a thread spins before it sleeps, some 0.2 ms.

Most waits within a training step are shorter: they last from one loop to the next, which Python starts. Waking a thread
takes so long on virtual machines that a step takes 1.3 times as long with 1,000 spins (measurements in docs/scale.md).
"""


def let_waiting_threads_sleep() -> None:
    """Limit how long torch's threads spin, in this process and its child processes.

    OpenMP reads the environment variable once, so this must be called before torch is imported.
    """
    if not any(name in os.environ for name in SPIN_SETTINGS):
        os.environ["GOMP_SPINCOUNT"] = str(SPINS)
