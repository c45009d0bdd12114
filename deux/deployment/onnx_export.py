"""A trained model as an ONNX file, for programs without PyTorch."""

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
from deux.errors import DeuxError
from deux.inference.prediction import complete, eval_mode, prepared_inputs

ONNX_FILE = "model.onnx"
PLAIN_INPUTS = ("image", "sparse_depth", "intrinsics")
OUTPUT = "depth"
TOLERANCE = 1e-3
"""How far, as a part of the depth, the exported model may be from PyTorch's."""

_PACKAGES = ("onnx", "onnxscript", "onnxruntime")
_TRACED = 2
"""Samples in the batch that is traced where any number is to be possible."""
_POINTS = 0.05
"""Part of the made-up pixels that have a sparse point."""


@dataclass(frozen=True)
class OnnxModel:
    """An exported model that has been compared with its original.

    Args:
        content: the .onnx file's.
        inputs: names and shapes; a dimension that may have any size is a name.
        difference: greatest difference of its depth in onnxruntime from PyTorch's, as a part of the depth.
    """

    content: bytes
    inputs: dict[str, tuple[int | str, ...]]
    difference: float


class _Completion(nn.Module):
    """All of `DepthModel.predict` that is made of tensor operations: outlier removal, padding, network, cropping."""

    def __init__(self, model: DepthModel, prepared: Sequence[str]) -> None:
        super().__init__()
        self.model = model
        self.prepared = list(prepared)

    def forward(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor, *prepared: Tensor) -> Tensor:
        named = dict(zip(self.prepared, prepared, strict=True))
        return complete(self.model, image, sparse_depth, intrinsics, named)


def check_packages() -> None:
    """Raise DeuxError if a package that exporting takes is not installed."""
    missing = [name for name in _PACKAGES if find_spec(name) is None]
    if missing:
        raise DeuxError(
            f"exporting needs {', '.join(_PACKAGES[:-1])} and {_PACKAGES[-1]}, and {' and '.join(missing)} "
            f'{"is" if len(missing) == 1 else "are"} not installed: pip install "deux[export]".'
        )


def export_onnx(model: DepthModel, height: int, width: int, batch: int | None = None) -> OnnxModel:
    """Export a model for images of one size, and compare it with the original on made-up inputs.

    The exported model takes what `DepthModel.predict` takes, under the same names, and what `DepthModel.prepare` makes
    of the sparse depth on the CPU, N x C x H x W by name. Outlier removal and padding are inside; the one output is
    `depth`, N x 1 x H x W metres. All are float32. The size is fixed: the networks choose their operations by it, and
    a graph holds one choice.

    Args:
        model: a model on the CPU.
        height: of the images, in pixels.
        width: likewise.
        batch: number of images at a time; None for any.

    Raises:
        DeuxError: a package is missing, an operation of the model cannot be exported, or the exported model's depth
            differs by more than `TOLERANCE`.
    """
    check_packages()
    data = made_up_inputs(model, batch or _TRACED, height, width)
    try:
        with eval_mode(model), torch.no_grad(), _silence():
            content = _exported(model, data, fixed=batch is not None)
            counts = [1, 3] if batch is None else [batch]
            checks = [made_up_inputs(model, count, height, width, seed=1) for count in counts]
            difference = float(np.max([_difference(content, model, check) for check in checks]))  # NaN if one is
    except Exception as error:  # what an exporter cannot do shows in many ways, depending on the step
        raise DeuxError(f"{type(model).__name__} cannot be exported as ONNX: {_reason(error)}.") from error
    if not difference <= TOLERANCE:  # nor if it is no number
        raise DeuxError(
            f"{type(model).__name__} cannot be exported as ONNX: the exported model's depth differs by up to "
            f"{difference:.2%} from PyTorch's, and at most {TOLERANCE:.1%} is taken for the same."
        )
    shapes = {name: ("N" if batch is None else batch, *value.shape[1:]) for name, value in data.items()}
    return OnnxModel(content, shapes, difference)


def made_up_inputs(model: DepthModel, count: int, height: int, width: int, seed: int = 0) -> dict[str, Tensor]:
    """Inputs of the exported model by name: random images, points anywhere in its range, a camera of 90 degrees."""
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
    # `*prepared` is one argument, and none where nothing is prepared.
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
        del node.metadata_props[:]  # notes for debugging, with the paths of this machine's files
    return bytes(proto.SerializeToString())


def _difference(content: bytes, model: DepthModel, data: dict[str, Tensor]) -> float:
    """Greatest difference between the exported and the original model's depth, as a part of the latter."""
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
    """No notices of the exporter's, which concern its own inner workings."""
    disabled = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(disabled)


def _reason(error: BaseException) -> str:
    """The first line of the error at the bottom of it."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[0].rstrip('.')}" if lines else type(error).__name__
