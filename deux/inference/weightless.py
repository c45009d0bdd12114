"""Networks without memory for their weights: to read their structure, or to check their options."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import torch
from torch.overrides import TorchFunctionMode


@contextmanager
def without_weights() -> Iterator[None]:
    """Make networks on PyTorch's meta device, where parameters have shapes and no values.

    Example:
        >>> with without_weights():
        ...     layer = torch.nn.Linear(3, 100_000)
        >>> layer.weight.device.type
        'meta'
    """
    with torch.device("meta"), _WithoutInitialisation():
        yield


class _WithoutInitialisation(TorchFunctionMode):
    """Leaves out the initialisation of parameters, which have no values here.

    On the meta device `Tensor.normal_` would import `torch._dynamo` first, which takes one to two seconds.
    """

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        kwargs = kwargs or {}
        if func is torch.Tensor.normal_ or getattr(func, "__module__", None) == "torch.nn.init":
            return args[0] if args else kwargs["tensor"]
        return func(*args, **kwargs)
