"""`task=export`: a trained model as an ONNX file."""

from dataclasses import dataclass

from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of
from deux.deployment.onnx_export import ONNX_FILE, check_packages, export_onnx
from deux.errors import check_range
from deux.geometry.camera import Camera
from deux.io.atomic import make_folder, write_atomically
from deux.tasks.checkpoints import load_needed_model
from deux.tasks.console import quieten_libraries, say


@dataclass(frozen=True)
class ExportSettings:
    """Which model is exported, and what it takes.

    Args:
        checkpoint: a run folder, a model file or the model's published checkpoint.
        height: of the images, in pixels; None for the camera's.
        width: likewise.
        batch: number of images at a time; None for any.

    Raises:
        DeuxError: a value is out of its range.
    """

    checkpoint: str | None
    height: int | None
    width: int | None
    batch: int | None

    def __post_init__(self) -> None:
        for name, value in (("height", self.height), ("width", self.width), ("batch", self.batch)):
            if value is not None:
                check_range(f"export.{name}", value, 1)


def run(cfg: DictConfig) -> None:
    """Export the model `export.checkpoint` as `model.onnx` in the run folder; a repeated command overwrites it."""
    quieten_libraries()
    sections = sections_of(cfg)
    chosen, camera = sections.read("export", ExportSettings), sections.read("camera", Camera)
    check_packages()
    name, model = load_needed_model(sections.plugin("model"), chosen.checkpoint, "export.checkpoint")
    height, width = chosen.height or camera.height, chosen.width or camera.width
    say(f"Export {name} for images of {width} x {height} pixels")
    exported = export_onnx(model, height, width, chosen.batch)
    folder = run_folder()
    make_folder(folder)
    write_atomically(folder / ONNX_FILE, exported.content)
    say(str(folder / ONNX_FILE))
    for option, shape in exported.inputs.items():
        say(f"  {option}: {' x '.join(map(str, shape))}")
    say(
        f"onnxruntime's depth differs from PyTorch's by {exported.difference:.1e} of itself at most, on made-up inputs."
    )
