"""Depth Anything (Yang et al., CVPR 2024; V2: NeurIPS 2024) as a depth completion model, by `transformers`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional
from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation
from transformers.utils import logging

from deux.contracts import DepthModel, LossSettings, Prediction
from deux.errors import DeuxError
from deux.geometry.depth_correction import correct_depth
from deux_depth_anything.alignment import EPSILON, align

MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of the colours of ImageNet, on which the backbone was trained."""


class DepthAnything(DepthModel):
    """Depth of the image alone by Depth Anything, aligned to the sparse points.

    The network sees the image at its own resolution. Scale and shift of its inverse depth are fitted to the points
    robustly (`align`), and a smooth field then carries the result onto them (`correct_depth`).

    Args:
        weights: a folder with `config.json` and `model.safetensors` of a DepthAnythingForDepthEstimation, such as a
            download of Depth-Anything-V2-Small-hf, or of one of its metric versions. Nothing is downloaded.
        resolution: pixels of the network's image, as `size` of its `preprocessor_config.json`: less is faster.
        correct: whether the smooth field follows the alignment.
        min_depth: nearest depth in metres that is predicted.
        max_depth: farthest depth in metres that is predicted.

    Raises:
        DeuxError: the folder does not hold such a model.
    """

    pretrained = True
    objective: ClassVar[LossSettings] = {
        "color_consistency": 0.2,
        "structural_consistency": 0.8,
        "sparse_depth": 1.0,
        "local_smoothness": 0.01,
    }

    def __init__(
        self,
        weights: str,
        resolution: int = 518,
        correct: bool = True,
        min_depth: float = 0.1,
        max_depth: float = 10.0,
    ) -> None:
        super().__init__()
        self.resolution = resolution
        self.correct = correct
        self.min_depth = min_depth
        self.max_depth = max_depth
        self.network = load_network(Path(weights).expanduser())
        # What the checkpoint holds and depth estimation does not use.
        self.network.backbone.embeddings.mask_token.requires_grad_(False)
        self.network.neck.fusion_stage.layers[0].residual_layer1.requires_grad_(False)
        for name, values in (("mean", MEAN), ("deviation", DEVIATION)):
            self.register_buffer(name, torch.tensor(values)[:, None, None], persistent=False)

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        """Predict dense depth; shapes and units are those of `DepthModel.forward`."""
        relative = self.inverse_depth(image)
        with torch.autocast(image.device.type, enabled=False):
            sparse_depth = sparse_depth.float() * validity
            depth = align(relative, sparse_depth, validity, (self.min_depth, self.max_depth), self._is_metric)
            if self.correct:
                depth = self._correct(depth, sparse_depth)
        return Prediction(depth.clamp(self.min_depth, self.max_depth))

    def inverse_depth(self, image: Tensor) -> Tensor:
        """What the network sees: in 1 / metres if it is metric, otherwise up to scale and shift.

        Args:
            image: N x 3 x H x W in [0, 1].

        Returns:
            N x 1 x H x W float32.
        """
        config = self.network.config
        size = network_size(image.shape[2], image.shape[3], self.resolution, config.patch_size)
        resized = functional.interpolate(image.float(), size, mode="bicubic", align_corners=False, antialias=True)
        found = self.network((resized - self.mean) / self.deviation).predicted_depth[:, None].float()
        if self._is_metric:
            found = 1.0 / found.clamp(min=EPSILON)
        return functional.interpolate(found, image.shape[2:], mode="bilinear", align_corners=False)

    @property
    def _is_metric(self) -> bool:
        return bool(self.network.config.depth_estimation_type == "metric")

    @staticmethod
    def _correct(depth: Tensor, sparse_depth: Tensor) -> Tensor:
        """Each frame by the spacing of its own points."""
        points = (sparse_depth > 0).flatten(1).sum(1).clamp(min=1)
        spacing = (depth[0].numel() / points).sqrt()
        frames = zip(depth.split(1), sparse_depth.split(1), spacing, strict=True)
        return torch.cat([correct_depth(*frame) for frame in frames])


def network_size(height: int, width: int, resolution: int, multiple: int) -> tuple[int, int]:
    """Height and width of the network's image, as the published preprocessing makes it.

    The side becomes `resolution` that needs the lesser change of scale, the other follows, and both are rounded to
    whole patches of `multiple` pixels.
    """
    scale = min(resolution / height, resolution / width, key=lambda scale: abs(1 - scale))
    rows, columns = (max(multiple, round(scale * side / multiple) * multiple) for side in (height, width))
    return rows, columns


def load_network(folder: Path) -> DepthAnythingForDepthEstimation:
    """Read the network from safetensors, or make it without weights where PyTorch makes tensors without memory.

    Raises:
        DeuxError: the folder does not hold such a network.
    """
    wanted = "model.weights names a folder with config.json and model.safetensors of Depth Anything"
    if not (folder / "config.json").is_file():
        raise DeuxError(f"there is no {folder / 'config.json'}: {wanted}.")
    try:
        config = DepthAnythingConfig.from_pretrained(folder, local_files_only=True)
        if torch.empty(0).is_meta:
            return DepthAnythingForDepthEstimation(config)
        with _quiet():
            network, report = DepthAnythingForDepthEstimation.from_pretrained(
                folder, config=config, local_files_only=True, use_safetensors=True, output_loading_info=True
            )
    except Exception as error:  # of files that hold anything
        reason = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".")
        raise DeuxError(f"{folder} cannot be read: {wanted} ({reason}).") from error
    if wrong := sorted(report["missing_keys"]):
        raise DeuxError(f"{folder} holds weights of something else, it lacks {wrong[0]}: {wanted}.")
    return network.float()


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the progress bar and the notices of `transformers`; what matters of them is raised."""
    verbosity, bar = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(verbosity)
        if bar:
            logging.enable_progress_bar()
