"""`task=export`: export a trained model as an ONNX file, or as a checkpoint for its authors' published code."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of
from deux.contracts import DepthModel
from deux.deployment.onnx_export import ONNX_FILE, check_packages, export_onnx
from deux.deployment.published_checkpoints import PUBLISHED_FILE, save_published
from deux.errors import check_range
from deux.geometry.camera import Camera
from deux.io.atomic import make_folder, write_atomically
from deux.tasks.checkpoints import load_required_model
from deux.tasks.console import quieten_libraries, say


@dataclass(frozen=True)
class ExportSettings:
    """Options of the export of a model.

    Args:
        format: "onnx", or "published" for a checkpoint that the model's published code can load.
        checkpoint: a run folder, a model file or the model's published checkpoint.
        height: height of the images in pixels; None for the camera's.
        width: width of the images in pixels; None for the camera's.
        batch: fixed batch size; None for a dynamic one.

    Raises:
        DeuxError: a value is out of its range.
    """

    format: Literal["onnx", "published"]
    checkpoint: str | None
    height: int | None
    width: int | None
    batch: int | None

    def __post_init__(self) -> None:
        for name, value in (("height", self.height), ("width", self.width), ("batch", self.batch)):
            if value is not None:
                check_range(f"export.{name}", value, 1)


def run(cfg: DictConfig) -> None:
    """Export the model `export.checkpoint` to a file in the run folder; a repeated command overwrites it."""
    quieten_libraries()
    sections = sections_of(cfg)
    settings, camera = sections.read("export", ExportSettings), sections.read("camera", Camera)
    if settings.format == "onnx":
        check_packages()
    name, model = load_required_model(sections.plugin("model"), settings.checkpoint, "export.checkpoint")
    folder = run_folder()
    make_folder(folder)
    if settings.format == "published":
        save_published(model, name, folder / PUBLISHED_FILE)
        say(str(folder / PUBLISHED_FILE))
    else:
        size = settings.height or camera.height, settings.width or camera.width
        _write_onnx(model, name, size, settings.batch, folder)


def _write_onnx(model: DepthModel, name: str, size: tuple[int, int], batch: int | None, folder: Path) -> None:
    height, width = size
    say(f"Export {name} for images of {width} x {height} pixels")
    exported = export_onnx(model, height, width, batch)
    write_atomically(folder / ONNX_FILE, exported.content)
    say(str(folder / ONNX_FILE))
    for option, shape in exported.inputs.items():
        say(f"  {option}: {' x '.join(map(str, shape))}")
    say(
        f"Maximal relative difference between onnxruntime's and PyTorch's depth on random inputs: "
        f"{exported.difference:.1e}."
    )
