"""Switch between optimised and reference implementations of the same computation.

Pooling, structural similarity, projection and upsampling have an optimised implementation and a reference one, which
follows the published code of the depth models.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from torch import Tensor

_reference = False  # a plain global, which torch.compile can guard


def tuned_for_cpu(x: Tensor) -> bool:
    """Whether to use the implementation optimised for CPUs: for tensors on a CPU outside of `reference_forms`."""
    return x.is_cpu and not _reference


def fuses_steps() -> bool:
    """Whether to fuse steps that the published code computes separately, on any device."""
    return not _reference


@contextmanager
def reference_forms() -> Iterator[None]:
    """Use the reference implementations within a `with` block, in all threads, to compare with the published code."""
    global _reference
    before, _reference = _reference, True
    try:
        yield
    finally:
        _reference = before
