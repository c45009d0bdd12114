"""How torch's threads wait for each other: asleep after a short while, so that other programs keep their share.

The threads of GNU's OpenMP, on which torch computes, meet at the end of every parallel loop. One that comes early spins
for up to 300,000 turns, some milliseconds, before it sleeps. Where another program is at work on one of the cores, it
takes the time in which the thread that it waits for could have run.
"""

import os

SPIN_SETTINGS = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""What GNU's OpenMP reads when it is loaded; where one of these is set, by a user or a launcher, it holds."""

SPINS = 1000
"""Turns of the loop in which a thread waits before it sleeps, tens of microseconds.

Most waits within a training step are shorter than this. With none at all (OMP_WAIT_POLICY=passive) a small step takes
half as long again, for waking a thread. docs/scale.md has the measurements.
"""


def let_waiting_threads_sleep() -> None:
    """Bound how long torch's threads spin, in this process and those that it starts.

    The setting goes into the environment, which OpenMP reads once: call this before torch is imported. What is set
    there already stays.
    """
    if not any(name in os.environ for name in SPIN_SETTINGS):
        os.environ["GOMP_SPINCOUNT"] = str(SPINS)
