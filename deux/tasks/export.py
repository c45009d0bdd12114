"""`task=export`: a trained model as an ONNX file."""

from omegaconf import DictConfig

from deux.configuration import run_folder
from deux.deployment.onnx_export import ONNX_FILE, check_packages, export_onnx
from deux.io.atomic import make_folder, write_atomically
from deux.tasks.console import quieten_libraries, say
from deux.tasks.given import needed_model
from deux.tasks.settings import Settings


def run(cfg: DictConfig) -> None:
    """Export the model `checkpoint` as `model.onnx` in the run folder. A repeated command overwrites the file."""
    quieten_libraries()
    settings = Settings(cfg)
    check_packages()
    name, model = needed_model(settings, "checkpoint", settings.run.checkpoint)
    chosen = settings.export
    height, width = chosen.height or settings.camera.height, chosen.width or settings.camera.width
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
