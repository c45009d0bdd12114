"""What is installed and works here: the versions of packages, the graphics card, the renderers."""

import platform
from importlib.metadata import PackageNotFoundError, version

import numpy as np
import torch
from omegaconf import DictConfig

from deux.contracts import Material, SceneMesh
from deux.doctor.checkup import Checkup
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.renderers import RENDERERS, make_renderer

PACKAGES = ("deux", "torch", "torchvision", "lightning", "hydra-core", "kornia", "numpy", "trimesh", "embreex")


def check_installation(checkup: Checkup, cfg: DictConfig) -> None:
    """Report versions, graphics card and renderers; a renderer that the configuration chooses must work."""
    checkup.heading("Installation")
    versions = {name: found for name in PACKAGES if (found := _version(name))}
    checkup.fact("packages", ", ".join(f"{name} {number}" for name, number in versions.items()))
    checkup.fact("Python", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    checkup.fact("GPU", _graphics_card())
    try:
        simulator = registry().choose("simulators", cfg.simulator)
    except DeuxError as error:
        checkup.fault(str(error))
        return
    checkup.fact("simulator", simulator.name)
    chosen = simulator.settings.get("renderer")
    for name in RENDERERS:
        fault = _renderer_fault(name)
        if fault and name == chosen:
            checkup.fault(f"renderer {name}: {fault}")
        else:
            checkup.fact(f"  {name}", ("works" if not fault else f"does not work: {fault}"))


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _graphics_card() -> str:
    if not torch.cuda.is_available():
        built = (
            f"torch is built with CUDA {torch.version.cuda}" if torch.version.cuda else "torch is built without CUDA"
        )
        return f"none that torch can use ({built}): models run on the CPU"
    memory = torch.cuda.get_device_properties(0).total_memory / 2**30
    return f"{torch.cuda.get_device_name(0)}, {memory:.0f} GiB; {torch.cuda.device_count()} in all"


def _renderer_fault(name: str) -> str:
    """What keeps a renderer from drawing a square 2 m ahead of a camera; "" where nothing does."""
    corners = np.array([[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]], np.float32)
    square = SceneMesh(
        vertices=corners,
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        uv=np.zeros((2, 3, 2), np.float32),
        face_material=np.zeros(2, np.int32),
        materials=(Material("white"),),
        face_label=np.full(2, -1, np.int32),
    )
    try:
        (image,) = make_renderer(name, square, Camera(8, 8, hfov=45.0)).render(np.eye(4)[None])
    except Exception as error:  # OpenGL and its drivers raise whatever they like
        return f"{str(error) or type(error).__name__}"
    center = float(image.depth[4, 4])
    return "" if abs(center - 2.0) < 1e-3 else f"it draws a square 2 m ahead at {center:.2f} m."
