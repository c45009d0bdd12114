"""The section `predict` of the configuration: which frames, by which model, and what is made of their depth."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from deux.contracts import Uncertainty
from deux.errors import DeuxError, check_range
from deux.io.cloud_files import CLOUD_FORMATS, CloudFormat
from deux.registry import registry

FrameSplit = Literal["all", "train", "validation", "test"]
"""Which frames of a folder; all are those of every split and those between two of them."""

DepthFormat = Literal["png", "npy"]
"""How the depth of many frames is written: 16-bit PNG of metres x 256, or .npy of float32 metres."""


@dataclass(frozen=True)
class PredictSettings:
    """The model, the frames whose depth it completes, and what is written of them.

    Args:
        checkpoint: a run folder, a model file or the model's published checkpoint.
        image: one frame: an 8-bit image.
        data: many frames: a folder that the section `data` reads; with `sparse`, a folder of images or a video.
        split: which frames of a folder that the section `data` reads.
        sparse: depth of some pixels, as a 16-bit PNG or .npy file; with `data`, a folder of these.
        sparse_scale: stored values per metre in PNG files.
        intrinsics: a text or .npy file.
        ground_truth: depth to compare with, as `sparse`.
        ground_truth_scale: stored values per metre in its PNG files; None for `sparse_scale`.
        batch_size: of many frames, how many go through the model at once where they are of one size.
        format: of the depth and confidence of many frames.
        video: whether many frames are also drawn as a coloured video.
        uncertainty: the measure whose confidence, exp(-uncertainty), is written beside the depth; None for none.
        uncertainty_options: of the measure's constructor.
        export: formats of a coloured point cloud: a name, several, or none.
        voxel: edge in metres of the voxels that merge the points of a sequence; 0 keeps all.
        keep: fraction of the pixels, the most confident ones, that become points; None for all.
        least_confidence: confidence in (0, 1] that a point needs; None for any.
        agreement: greatest difference, as a fraction of the distance, between the depth of a pixel of a sequence and
            that of two other frames with which it becomes a point; None for any.
        viewer: "rerun" for a recording that its viewer plays; None for none.

    Raises:
        DeuxError: a value is out of its range, or a filter has no measure to filter by.
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
        """The formats of the point cloud, each once; none if there is to be no cloud."""
        chosen = (self.export,) if isinstance(self.export, str) else self.export or ()
        return tuple(name for name in CLOUD_FORMATS if name in chosen)

    def make_measure(self) -> Uncertainty | None:
        """The measure of uncertainty; None if none is chosen.

        Raises:
            DeuxError: there is no such measure, or an option that it does not have.
        """
        if self.uncertainty is None:
            return None
        settings = {"name": self.uncertainty, **self.uncertainty_options}
        measure: Uncertainty = registry().choose("uncertainties", settings, "predict.uncertainty_options").create()
        return measure
