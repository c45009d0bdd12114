"""The losses of a training step, and their gradients, replayed as one CUDA graph (`training.cuda_graphs`)."""

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
"""Shapes of batches that get a graph of their own; each holds the memory of a step."""


class StepValues(NamedTuple):
    """What a training step computes before its backward pass.

    Args:
        total: the loss, with its gradient.
        logged: scalars for the log by name, detached.
        mean_depth: the mean predicted depth in metres, detached.
    """

    total: Tensor
    logged: dict[str, Tensor]
    mean_depth: Tensor


class GraphedStep:
    """Computes a step's values with one launch where PyTorch makes a thousand.

    At the batch sizes that a card is fast with, the host takes longer to launch a step's operations one by one than
    the card takes to do them. Here they are recorded once for each shape of batch by
    `torch.cuda.make_graphed_callables`, forward and backward, and replayed from then on with the same kernels in the
    same order. What is returned is valid until the next call.

    The weights must stay where they are in memory. Forward hooks of the networks run while recording only.

    Args:
        networks: holds all weights and buffers that `compute` uses.
        compute: the step's values from a batch on the card; nothing in it makes the host wait.
    """

    def __init__(self, networks: nn.Module, compute: Callable[[Batch], StepValues]) -> None:
        self._networks = networks
        self._compute = compute
        self._graphs: dict[tuple[object, ...], _FlatStep] = {}

    def __call__(self, batch: Batch) -> StepValues:
        """The values for a batch, from a graph if its shape has one or there is room for another."""
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
        """Give the graphs' memory back; they are recorded anew if the step is called again."""
        for step in self._graphs.values():
            vars(step).pop("forward", None)  # the replay, which refers to the step
        self._graphs.clear()
        gc.collect()  # the replays' classes are unreachable now, and no one else frees those

    def _record(self, batch: Batch) -> "_FlatStep":
        """Record a graph, and leave buffers and random numbers as they were: recording runs the step several times.

        Returns:
            The step, which replays the graph when it is called.
        """
        inputs = {name: tensor.clone() for name, tensor in _tensors(batch).items()}  # the graph reads from here
        step = _FlatStep(self._networks, self._compute, _with_tensors(batch, inputs))
        device = batch.image.device
        buffers = [(buffer, buffer.clone()) for buffer in self._networks.buffers()]
        # A graph may not use casts of the weights that autocast has kept from before it.
        autocast = torch.autocast(
            device.type,
            torch.get_autocast_dtype(device.type),
            enabled=torch.is_autocast_enabled(device.type),
            cache_enabled=False,
        )
        # Recording happens on a stream of its own, which the nodes that take the gradients remember; PyTorch from 2.10
        # on warns of the events that it then sets between both streams.
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
    """A step's values as a function from tensors to tensors, the way `make_graphed_callables` takes them."""

    logged: tuple[str, ...] = ()
    """Names of the values in the log; known after the first call."""

    def __init__(self, networks: nn.Module, compute: Callable[[Batch], StepValues], template: Batch) -> None:
        super().__init__()
        self.networks = networks
        self._compute = compute
        self._template = template

    def forward(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        """Take a batch apart and its values together."""
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
    """A batch with other tensors in the places that `_tensors` names."""
    own = {name: tensor for name, tensor in tensors.items() if "." not in name}
    return replace(template, **own, prepared={name: tensors[f"prepared.{name}"] for name in template.prepared})
