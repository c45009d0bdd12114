"""Export of trained models as ONNX files, for programs without PyTorch."""

import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from deux.contracts import DepthModel
from deux.errors import DeuxError, first_line, plural
from deux.inference.prediction import complete, eval_mode, prepared_inputs

ONNX_FILE = "model.onnx"
PLAIN_INPUTS = ("image", "sparse_depth", "intrinsics")
OUTPUT = "depth"
TOLERANCE = 1e-3
"""Maximal relative difference between the exported model's and PyTorch's depth."""

_PACKAGES = ("onnx", "onnxscript", "onnxruntime")
_TRACED = 2
"""Batch size for tracing a model with a dynamic batch size."""
_POINTS = 0.05
"""Fraction of the pixels of random inputs that have a sparse point."""


@dataclass(frozen=True)
class OnnxModel:
    """An exported model that was compared with the original.

    Args:
        content: content of the .onnx file.
        inputs: shapes of the inputs by name; dynamic dimensions are names.
        difference: maximal relative difference between onnxruntime's and PyTorch's depth.
    """

    content: bytes
    inputs: dict[str, tuple[int | str, ...]]
    difference: float


class _Completion(nn.Module):
    """The tensor operations of `DepthModel.predict`: outlier removal, padding, network and cropping."""

    def __init__(self, model: DepthModel, prepared: Sequence[str]) -> None:
        super().__init__()
        self.model = model
        self.prepared = list(prepared)

    def forward(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor, *prepared: Tensor) -> Tensor:
        named = dict(zip(self.prepared, prepared, strict=True))
        return complete(self.model, image, sparse_depth, intrinsics, named)


def check_packages() -> None:
    """Raise DeuxError if a package that is needed for the export is not installed."""
    missing = [name for name in _PACKAGES if find_spec(name) is None]
    if missing:
        raise DeuxError(
            f"exporting needs {', '.join(_PACKAGES[:-1])} and {_PACKAGES[-1]}, and {' and '.join(missing)} "
            f'{plural("is", len(missing))} not installed: pip install "deux[export]".'
        )


def export_onnx(model: DepthModel, height: int, width: int, batch: int | None = None) -> OnnxModel:
    """Export a model for images of one size, and compare it with the original on random inputs.

    The inputs are those of `DepthModel.predict`, and the tensors that `DepthModel.prepare` computes from the sparse
    depth on the CPU, N x C x H x W by name. The graph includes outlier removal and padding. The output is `depth`,
    N x 1 x H x W metres. All tensors are float32. The image size is fixed, since the networks' operations depend on it.

    Args:
        model: a model on the CPU.
        height: height of the images in pixels.
        width: width of the images in pixels.
        batch: fixed batch size; None for a dynamic one.

    Raises:
        DeuxError: a package is missing, an operation of the model cannot be exported, or the exported model's depth
            differs by more than `TOLERANCE`.
    """
    check_packages()
    data = random_inputs(model, batch or _TRACED, height, width)
    try:
        with eval_mode(model), torch.no_grad(), _silence():
            content = _exported(model, data, fixed=batch is not None)
            counts = [1, 3] if batch is None else [batch]
            checks = [random_inputs(model, count, height, width, seed=1) for count in counts]
            difference = float(np.max([_difference(content, model, check) for check in checks]))  # NaN if one is NaN
    except Exception as error:  # the exporter raises errors of many types
        raise DeuxError(f"{type(model).__name__} cannot be exported as ONNX: {_reason(error)}.") from error
    if not difference <= TOLERANCE:  # also for NaN
        raise DeuxError(
            f"{type(model).__name__} cannot be exported as ONNX: the exported model's depth differs by up to "
            f"{difference:.2%} from PyTorch's, more than the tolerance of {TOLERANCE:.1%}."
        )
    shapes = {name: ("N" if batch is None else batch, *value.shape[1:]) for name, value in data.items()}
    return OnnxModel(content, shapes, difference)


def random_inputs(model: DepthModel, count: int, height: int, width: int, seed: int = 0) -> dict[str, Tensor]:
    """Inputs of the exported model by name: random images, random points in its depth range, a camera of 90 degrees."""
    generator = torch.Generator().manual_seed(seed)
    size = (count, 1, height, width)
    depth = model.min_depth + (model.max_depth - model.min_depth) * torch.rand(size, generator=generator)
    sparse_depth = torch.where(torch.rand(size, generator=generator) < _POINTS, depth, 0.0)
    f = width / 2
    camera = torch.tensor([[f, 0.0, (width - 1) / 2], [0.0, f, (height - 1) / 2], [0.0, 0.0, 1.0]])
    return {
        "image": torch.rand(count, 3, height, width, generator=generator),
        "sparse_depth": sparse_depth,
        "intrinsics": camera.repeat(count, 1, 1),
        **prepared_inputs(model, sparse_depth),
    }


def _exported(model: DepthModel, data: dict[str, Tensor], fixed: bool) -> bytes:
    """The content of the .onnx file."""
    prepared = [name for name in data if name not in PLAIN_INPUTS]
    number = {0: torch.export.Dim("N")}
    # `*prepared` counts as one argument, or none if it is empty.
    dynamic = [number for _ in PLAIN_INPUTS] + ([tuple(number for _ in prepared)] if prepared else [])
    program = torch.onnx.export(
        _Completion(model, prepared),
        tuple(data.values()),
        input_names=list(data),
        output_names=[OUTPUT],
        dynamic_shapes=None if fixed else tuple(dynamic),
        dynamo=True,
        verbose=False,
    )
    assert program is not None
    proto = program.model_proto
    for node in proto.graph.node:
        del node.metadata_props[:]  # debugging information with local paths
    return bytes(proto.SerializeToString())


def _difference(content: bytes, model: DepthModel, data: dict[str, Tensor]) -> float:
    """Maximal relative difference between the exported and the original model's depth."""
    expected = model.predict(*(data[name] for name in PLAIN_INPUTS)).numpy()
    depth = _run_onnx(content, {name: value.numpy() for name, value in data.items()})[0]
    return float(np.max(np.abs(depth - expected) / expected))


def _run_onnx(content: bytes, data: dict[str, np.ndarray]) -> Sequence[np.ndarray]:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors
    options.intra_op_num_threads = torch.get_num_threads()
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    outputs: Sequence[Any] = session.run([OUTPUT], data)
    return outputs


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress the exporter's warnings and logs."""
    disabled = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(disabled)


def _reason(error: BaseException) -> str:
    """The first line of the root cause of an error."""
    while error.__cause__ is not None:
        error = error.__cause__
    return first_line(error)
