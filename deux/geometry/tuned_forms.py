"""Which form of a computation runs: one that was written for speed, or the natural one.

Some computations have two forms with the same values: pools along the rows and then along the columns, structural
similarity by shifted views, projection by broadcasts, enlargement merged into the convolution. All of them ask here.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from torch import Tensor

_natural = False  # a plain global, which torch.compile can guard


def tuned_for_cpu(x: Tensor) -> bool:
    """Whether to take the form that was written for CPUs: on a CPU, unless `natural_forms` asks for the other one."""
    return x.is_cpu and not _natural


def merges_steps() -> bool:
    """Whether steps may be merged that the published code computes one after the other, on any device."""
    return not _natural


@contextmanager
def natural_forms() -> Iterator[None]:
    """Compute for a while as the published code of the depth models does, to compare with it. In all threads."""
    global _natural
    before, _natural = _natural, True
    try:
        yield
    finally:
        _natural = before
