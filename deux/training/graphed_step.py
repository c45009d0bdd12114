"""A training step's forward and backward pass, recorded and replayed as a CUDA graph (`training.cuda_graphs`)."""

import gc
import logging
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import NamedTuple

import torch
from torch import Tensor, nn

from deux.contracts import Batch

log = logging.getLogger(__name__)

MAX_GRAPHS = 4
"""Number of batch shapes for which graphs are recorded; each graph holds the memory of a step."""


class StepValues(NamedTuple):
    """The output of a training step's forward pass.

    Args:
        total: the loss, with its gradient.
        logged: scalars for the log by name, detached.
        mean_depth: the mean predicted depth in metres, detached.
    """

    total: Tensor
    logged: dict[str, Tensor]
    mean_depth: Tensor


class GraphedStep:
    """Computes a step's values from a CUDA graph: one launch instead of a thousand.

    At usual batch sizes, launching a step's kernels takes the host longer than the GPU needs to run them. Here,
    `torch.cuda.make_graphed_callables` records forward and backward pass once for each shape of batch; later steps
    replay the same kernels in the same order. Returned tensors are valid until the next call.

    The weights must keep their place in memory. Forward hooks of the networks run only during recording.

    Args:
        networks: contains all weights and buffers that `compute` uses.
        compute: computes a step's values from a batch on the GPU, without synchronising host and device.
    """

    def __init__(self, networks: nn.Module, compute: Callable[[Batch], StepValues]) -> None:
        self._networks = networks
        self._compute = compute
        self._graphs: dict[tuple[object, ...], _FlatStep] = {}

    def __call__(self, batch: Batch) -> StepValues:
        """Compute the values for a batch, from a graph unless `MAX_GRAPHS` graphs of other shapes exist."""
        tensors = _tensors(batch)
        shape = tuple((name, tensor.shape, tensor.dtype) for name, tensor in tensors.items())
        if shape not in self._graphs:
            if len(self._graphs) == MAX_GRAPHS:
                return self._compute(batch)
            self._graphs[shape] = self._record(batch)
        step = self._graphs[shape]
        total, *logged, mean_depth = step(*tensors.values())
        return StepValues(total, dict(zip(step.logged, logged, strict=True)), mean_depth)

    def free(self) -> None:
        """Free the graphs' memory; they are recorded again if the step is called again."""
        for step in self._graphs.values():
            vars(step).pop("forward", None)  # the replay function, which references the step
        self._graphs.clear()
        gc.collect()  # frees the replays' classes, which are in reference cycles

    def _record(self, batch: Batch) -> "_FlatStep":
        """Record a graph. Buffers and random state are restored, since recording runs the step several times.

        Returns:
            The step; calling it replays the graph.
        """
        inputs = {name: tensor.clone() for name, tensor in _tensors(batch).items()}  # the graph reads from here
        step = _FlatStep(self._networks, self._compute, _with_tensors(batch, inputs))
        device = batch.image.device
        buffers = [(buffer, buffer.clone()) for buffer in self._networks.buffers()]
        # A graph must not use casts of the weights that autocast cached before recording.
        autocast = torch.autocast(
            device.type,
            torch.get_autocast_dtype(device.type),
            enabled=torch.is_autocast_enabled(device.type),
            cache_enabled=False,
        )
        # Recording uses its own stream, which AccumulateGrad nodes remember; from PyTorch 2.10 on, synchronising both
        # streams causes a warning.
        if hasattr(torch.autograd.graph, "set_warn_on_accumulate_grad_stream_mismatch"):
            torch.autograd.graph.set_warn_on_accumulate_grad_stream_mismatch(False)
        with torch.random.fork_rng([device]), autocast:
            torch.cuda.make_graphed_callables(step, tuple(inputs.values()), allow_unused_input=True)
        with torch.no_grad():
            for buffer, before in buffers:
                buffer.copy_(before)
        log.info("recorded a CUDA graph of training steps with images of %s", tuple(batch.image.shape))
        return step


class _FlatStep(nn.Module):
    """A step as a module from tensors to tensors, as `make_graphed_callables` requires."""

    logged: tuple[str, ...] = ()
    """Names of the logged values; set by the first call."""

    def __init__(self, networks: nn.Module, compute: Callable[[Batch], StepValues], template: Batch) -> None:
        super().__init__()
        self.networks = networks
        self._compute = compute
        self._template = template

    def forward(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        """Assemble the batch, and flatten the step's values."""
        names = _tensors(self._template)
        values = self._compute(_with_tensors(self._template, dict(zip(names, tensors, strict=True))))
        self.logged = tuple(values.logged)
        return (values.total, *values.logged.values(), values.mean_depth)


def _tensors(batch: Batch) -> dict[str, Tensor]:
    """The tensors of a batch by name."""
    own = {field.name: getattr(batch, field.name) for field in fields(batch)}
    named = {name: value for name, value in own.items() if isinstance(value, Tensor)}
    return named | {f"prepared.{name}": value for name, value in batch.prepared.items()}


def _with_tensors(template: Batch, tensors: Mapping[str, Tensor]) -> Batch:
    """A copy of a batch with other tensors, named as by `_tensors`."""
    own = {name: tensor for name, tensor in tensors.items() if "." not in name}
    return replace(template, **own, prepared={name: tensors[f"prepared.{name}"] for name in template.prepared})
