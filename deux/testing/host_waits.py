"""Check that code does not make the host wait for the GPU.

CUDA operations are asynchronous: the host queues them and continues. The host has to wait for the GPU to read a value
(`item`), for an operation whose output size depends on values (`nonzero`, a boolean index) and to create a tensor from
Python numbers. `torch.cuda.set_sync_debug_mode` detects this on a GPU; this module detects it on the CPU.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

aten = torch.ops.aten

_READS = "reads values on the host; keep them in tensors, or log them detached"
_SIZES = "has a result whose size depends on values; use torch.where or multiply by the mask"
_COPIES = "copies numbers from the host; use torch.full, eye or arange with device=, or a registered buffer"
_CHECKS = "checks its result on the host; use the variant with the ending _ex, or another formula"

_FUNCTIONS: dict[Any, str] = {
    Tensor.tolist: _READS,
    Tensor.numpy: _READS,
    Tensor.cpu: _READS,
    Tensor.__array__: _READS,
    Tensor.__repr__: _READS,
    Tensor.allclose: _READS,
    torch.allclose: _READS,
    torch.from_numpy: _COPIES,
}
"""Functions that would make the host wait, but that call no operator for tensors on the CPU."""

_OPERATORS: dict[Any, str] = {
    aten._local_scalar_dense: _READS,
    aten.is_nonzero: _READS,
    aten.equal: _READS,
    aten.nonzero: _SIZES,
    aten.nonzero_numpy: _SIZES,
    aten.argwhere: _SIZES,
    aten.masked_select: _SIZES,
    aten._unique: _SIZES,
    aten._unique2: _SIZES,
    aten.unique_dim: _SIZES,
    aten.unique_consecutive: _SIZES,
    aten.bincount: _SIZES,
    aten.lift_fresh: _COPIES,
    aten._linalg_check_errors: _CHECKS,
}
"""ATen operators that make the host wait."""

_IS_CPU = vars(torch._C.TensorBase)["is_cpu"].__get__


class HostWait(AssertionError):
    """Raised for an operation that would make the host wait for the GPU."""


@contextmanager
def refuse_host_waits() -> Iterator[None]:
    """Context manager that raises `HostWait` for an operation that would make the host wait if tensors were on a GPU.

    Inside, `Tensor.is_cpu` is False, so that code with separate paths for CPU and GPU takes the path for the GPU.
    Backward passes and optimiser steps are supported; optimisers need `fused=True`, since others count their steps on
    the host.

    Example:
        >>> with refuse_host_waits():
        ...     float(torch.ones(3).sum())
        Traceback (most recent call last):
        deux.testing.host_waits.HostWait: aten._local_scalar_dense reads values on the host; keep them in tensors, ...

    Raises:
        HostWait: an operation would make the host wait; the traceback shows its line of code.
    """
    with _Functions(), _Operators():
        yield


class _Functions(TorchFunctionMode):
    """Checks the functions of torch that are called with tensors."""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        kwargs = kwargs or {}
        if func == _IS_CPU:
            return False
        if func in _FUNCTIONS and not _is_on_host(args):
            raise HostWait(f"{func.__name__} {_FUNCTIONS[func]}.")
        if func is Tensor.to and "cpu" in (args[1:2] or (kwargs.get("device"),)):
            if not kwargs.get("non_blocking"):
                raise HostWait(f'to("cpu") {_READS}, or copy them with non_blocking=True and look at them later.')
            copied = args[0].detach().clone()
            copied.is_on_host = True
            return copied
        if func is Tensor.__setitem__ and isinstance(args[2], int | float):
            # A GPU fills in the number without a copy, which the CPU would make.
            args = (*args[:2], torch.full((), args[2], dtype=args[0].dtype))
        return func(*args, **kwargs)


class _Operators(TorchDispatchMode):
    """Checks the ATen operators, including those of backward passes."""

    def __torch_dispatch__(
        self,
        func: Any,
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        operator, kwargs = func.overloadpacket, kwargs or {}
        reason = _OPERATORS.get(operator) or _by_arguments(operator, args, kwargs)
        if reason is not None and not _is_on_host(args):
            raise HostWait(f"{operator} {reason}.")
        return func(*args, **kwargs)


def _is_on_host(args: Sequence[Any]) -> bool:
    """Whether the first argument is a copy by `to("cpu", non_blocking=True)`."""
    return bool(args) and getattr(args[0], "is_on_host", False)


def _by_arguments(operator: Any, args: Sequence[Any], kwargs: Mapping[str, Any]) -> str | None:
    """Reason why the host waits for an operator with these arguments; None if it does not."""
    if operator is aten.index and _has_mask(args[1]):
        return _SIZES
    if operator in (aten.index_put, aten.index_put_, aten._index_put_impl_) and _has_mask(args[1]):
        return None if args[2].numel() == 1 else _SIZES  # the size of a single number is known
    if operator is aten.repeat_interleave and kwargs.get("output_size") is None:
        return _SIZES if isinstance(args[-1], Tensor) else None  # a tensor of repeats, or a number
    return None


def _has_mask(indices: Sequence[Tensor | None]) -> bool:
    return any(index is not None and index.dtype in (torch.bool, torch.uint8) for index in indices)
