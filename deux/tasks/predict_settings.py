"""Options of the section `predict`: model, frames and outputs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from deux.contracts import Uncertainty
from deux.errors import DeuxError, check_range
from deux.io.cloud_files import CLOUD_FORMATS, CloudFormat
from deux.registry import registry

FrameSplit = Literal["all", "train", "validation", "test"]
"""Which frames of a folder; "all" includes frames that are in no split."""

DepthFormat = Literal["png", "npy"]
"""File format of the depth of many frames: 16-bit PNG of metres x 256, or .npy of float32 metres."""


@dataclass(frozen=True)
class PredictSettings:
    """Options of the prediction: the model, the frames and the outputs.

    Args:
        checkpoint: a run folder, a model file or the model's published checkpoint.
        image: a single frame: an 8-bit image.
        data: many frames: a folder that the section `data` reads; with `sparse`, a folder of images or a video.
        split: which frames of a folder that the section `data` reads.
        sparse: sparse depth, as a 16-bit PNG or .npy file; with `data`, a folder of these.
        sparse_scale: stored values per metre in PNG files.
        intrinsics: a text or .npy file with the camera matrix.
        ground_truth: depth to compare with, in the format of `sparse`.
        ground_truth_scale: stored values per metre in its PNG files; None for `sparse_scale`.
        corrected: whether the depth is multiplied by a smooth field that aligns it with the sparse points
            (`deux.geometry.depth_correction`); uncertainty is that of the model's own depth.
        batch_size: number of frames of the same size that are predicted at once.
        format: file format of the depth and confidence of many frames.
        video: whether a coloured video of many frames is written.
        uncertainty: uncertainty measure whose confidence, exp(-uncertainty), is written besides the depth; None for no
            confidence.
        uncertainty_options: options of the measure's constructor.
        export: one or several formats of a coloured point cloud; None for no point cloud.
        voxel: edge length in metres of the voxels in which the points of a sequence are merged; 0 keeps all points.
        keep: fraction of the pixels, the most confident ones, that become points; None for all.
        least_confidence: minimal confidence of points, in (0, 1]; None for no minimum.
        agreement: consistency filter of the points of a sequence: maximal difference of their depth to that of two
            other frames, as a fraction of the distance; None for no filter.
        viewer: "rerun" for a recording for this viewer; None for no recording.

    Raises:
        DeuxError: a value is out of its range, or a confidence filter has no uncertainty measure.
    """

    checkpoint: str | None
    image: str | None
    sparse: str | None
    sparse_scale: float
    intrinsics: str | None
    ground_truth: str | None
    ground_truth_scale: float | None
    data: str | None = None
    split: FrameSplit = "all"
    corrected: bool = False
    batch_size: int = 4
    format: DepthFormat = "png"
    video: bool = True
    uncertainty: str | None = None
    uncertainty_options: Mapping[str, Any] = field(default_factory=dict)
    export: CloudFormat | tuple[CloudFormat, ...] | None = None
    voxel: float = 0.02
    keep: float | None = None
    least_confidence: float | None = None
    agreement: float | None = 0.03
    viewer: Literal["rerun"] | None = None

    def __post_init__(self) -> None:
        check_range("predict.sparse_scale", self.sparse_scale, 0, ends=False)
        if self.ground_truth_scale is not None:
            check_range("predict.ground_truth_scale", self.ground_truth_scale, 0, ends=False)
        check_range("predict.batch_size", self.batch_size, 1)
        check_range("predict.voxel", self.voxel, 0)
        if self.agreement is not None:
            check_range("predict.agreement", self.agreement, 0, 1, ends=False)
        for name in ("keep", "least_confidence"):
            value = getattr(self, name)
            if value is None:
                continue
            check_range(f"predict.{name}", value, 0, 1)
            if self.uncertainty is None:
                raise DeuxError(
                    f"predict.{name} filters points by their confidence: choose a measure with predict.uncertainty=, "
                    f"such as {' or '.join(registry().names('uncertainties'))}."
                )

    @property
    def cloud_formats(self) -> tuple[CloudFormat, ...]:
        """The formats of the point cloud, without duplicates; empty if no point cloud is to be written."""
        chosen = (self.export,) if isinstance(self.export, str) else self.export or ()
        return tuple(name for name in CLOUD_FORMATS if name in chosen)

    def make_measure(self) -> Uncertainty | None:
        """Create the uncertainty measure; None if none is chosen.

        Raises:
            DeuxError: the measure or one of its options is unknown.
        """
        if self.uncertainty is None:
            return None
        settings = {"name": self.uncertainty, **self.uncertainty_options}
        measure: Uncertainty = registry().choose("uncertainties", settings, "predict.uncertainty_options").create()
        return measure
