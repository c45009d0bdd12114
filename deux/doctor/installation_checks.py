"""Checks of the installation: versions of packages, extras, simulators and renderers."""

from importlib.metadata import PackageNotFoundError, metadata, requires, version

import numpy as np
from omegaconf import DictConfig
from packaging.requirements import Requirement

from deux.contracts import Material, SceneMesh
from deux.doctor.checkup import Checkup
from deux.doctor.plugin_checks import lacking
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.renderers import RENDERERS, make_renderer

DEVELOPMENT = ("test", "dev", "docs")
"""Extras for the development of deux, which are not reported."""


def check_packages(checkup: Checkup) -> None:
    """Report the versions of dependencies, and the missing packages of extras; a missing dependency is a fault."""
    checkup.heading("Packages")
    requirements = [Requirement(text) for text in requires("deux") or ()]
    checkup.fact("deux", _version("deux") or "not installed")
    missing = []
    for needed in requirements:
        if needed.marker is None or needed.marker.evaluate({"extra": ""}):
            installed = _version(needed.name)
            if installed and needed.specifier.contains(installed, prereleases=True):
                checkup.fact(needed.name, installed)
            else:
                missing.append(f"{needed.name}{needed.specifier} ({installed or 'not'} installed)")
    if missing:
        checkup.fault(f'deux needs {", ".join(missing)}: pip install "deux".')
    for extra in sorted(set(metadata("deux").get_all("Provides-Extra") or ()) - set(DEVELOPMENT)):
        of_extra = [needed for needed in requirements if needed.marker and needed.marker.evaluate({"extra": extra})]
        absent = [needed.name for needed in of_extra if _version(needed.name) is None]
        checkup.fact(f"deux[{extra}]", f"lacks {', '.join(absent)}" if absent else "installed")


def check_simulators(checkup: Checkup, cfg: DictConfig) -> None:
    """Test each renderer and simulator; one that the configuration chooses and does not work is a fault."""
    checkup.heading("Simulators and renderers")
    chosen, renderer = cfg.simulator.get("name"), None
    try:
        renderer = registry().choose("simulators", cfg.simulator).settings.get("renderer")
    except DeuxError as error:
        checkup.fault(str(error))
    for name in registry().names("simulators"):
        try:
            problem = lacking(registry().get("simulators", name))
        except DeuxError as error:
            problem = str(error)
        if problem and name == chosen:
            checkup.fault(f"simulator {name}: {problem}")
        else:
            checkup.fact(f"simulator {name}", problem or "can be used")
    for name in RENDERERS:
        fault = _renderer_fault(name)
        if fault and name == renderer:
            checkup.fault(f"renderer {name}: {fault}")
        else:
            checkup.fact(f"renderer {name}", ("works" if not fault else f"does not work: {fault}"))


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _renderer_fault(name: str) -> str:
    """Render a square 2 m in front of a camera; returns what is wrong, or ""."""
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
    except Exception as error:  # OpenGL and its drivers may raise anything
        return f"{str(error) or type(error).__name__}"
    center = float(image.depth[4, 4])
    return "" if abs(center - 2.0) < 1e-3 else f"it renders a square in a distance of 2 m at {center:.2f} m."
