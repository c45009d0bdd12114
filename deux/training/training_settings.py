"""The options of the section `training`: budget, data loading, optimiser and precision."""

from dataclasses import dataclass, field

from deux.data.augmentation_settings import AugmentationSettings
from deux.errors import DeuxError, check_range
from deux.io.layout import SourceChoice
from deux.training.network_compilation import CompileMode
from deux.training.schedule import Schedule


@dataclass(frozen=True)
class TrainingSettings(Schedule):
    """Options of a training besides the learning rate schedule. The defaults are the paper's.

    Args:
        batch_size: samples in a batch.
        epochs: passes over the frames; unused if `steps` is set.
        steps: optimiser steps; equal for all explorers in a comparison.
        betas: Adam's decay rates of the running means of the gradient and of its square. With 0.999, the published
            value, the mean covers some 1,000 steps: after the gradient has grown quickly, hundreds of steps are too
            large (docs/decisions/0028-adam-memory.md).
        crop: height and width of the samples; None for whole frames.
        num_workers: processes that load data. None: no process if the frames are cached on the device, else one less
            than there are cores, at most eight.
        validations: minimal number of validations over the whole training, as far as it has that many steps or epochs.
            They are evenly spread over whole steps or epochs, which can make up to twice as many.
        sources: how source frames are chosen. "baseline": of the five frames before and after the target, the two that
            show most of it with parallax, by poses and sparse points (`deux.geometry.source_frames`); "recent": the
            paper's t-1 and t-2, or those at `offsets`.
        offsets: the recent source frames as offsets from the target, in frames, if the dataset does not list them;
            unused with "baseline", except for sequences without poses.
        checkpoint_minutes: time between two checkpoints within an epoch; there is also one at the end of each epoch.
        tf32: on a GPU, let the networks' float32 convolutions round to TensorFloat-32 (10 bits of mantissa); the
            geometry never does. No gain in bf16-mixed, the default there.
        cuda_graphs: on a GPU, record the networks and losses of a step as a CUDA graph and replay it: the same kernels
            without the host's launch overhead. Not used with several processes or gradient accumulation.
        compile: compile the networks, and on a GPU the objective, by `torch.compile` in this mode; true is "default",
            the other modes use CUDA graphs themselves. The first step takes up to minutes longer.
        averaging: fraction of the training, from its end, over whose steps the weights of the final model are averaged;
            0 uses those of the last step.
        supervised: let the objective read ground truth even if the model was published as an unsupervised one.
        augmentation: how samples differ from the stored frames, such as in camera and sparse points.
        start: initial weights of the final model in place of random ones: a run folder, a model file, the model's
            published checkpoint or the name of a shipped model. Seed models and foundations start from random weights.

    Raises:
        DeuxError: a value is out of its range.
    """

    batch_size: int = 8
    epochs: int = 25
    steps: int | None = None
    betas: tuple[float, float] = (0.9, 0.999)
    crop: tuple[int, int] | None = None
    num_workers: int | None = None
    validations: int = 10
    sources: SourceChoice = "baseline"
    offsets: tuple[int, ...] = (-1, -2)
    checkpoint_minutes: float = 10.0
    tf32: bool = False
    cuda_graphs: bool = True
    compile: CompileMode | bool = False
    averaging: float = 0.0
    supervised: bool = False
    augmentation: AugmentationSettings = field(default_factory=AugmentationSettings)
    start: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("training.batch_size", self.batch_size, 1)
        check_range("training.epochs", self.epochs, 1)
        check_range("training.num_workers", self.num_workers or 0, 0)
        check_range("training.validations", self.validations, 1)
        check_range("training.checkpoint_minutes", self.checkpoint_minutes, 0)
        check_range("training.averaging", self.averaging, 0, 1)
        if self.steps is not None:
            check_range("training.steps", self.steps, 1)
        if not all(0.0 <= beta < 1.0 for beta in self.betas):
            raise DeuxError(f"training.betas is {list(self.betas)}: both must be at least 0 and below 1.")
        for size in self.crop or ():
            check_range("training.crop", size, 1)
        if not self.offsets or 0 in self.offsets:
            raise DeuxError(
                f"training.offsets is {list(self.offsets)}: it lists the source frames as distances from the target, "
                "such as [-1,-2], none of them 0."
            )
