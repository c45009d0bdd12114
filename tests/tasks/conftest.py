"""The smallest experiment that goes through every stage, as a user runs it, and smaller ones in this process."""

import io
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from hydra._internal.hydra import Hydra
from matplotlib.figure import Figure

from deux.contracts import DepthModel, Prediction
from deux.deployment.model_files import save_model
from deux.registry import registry

SMALLEST = [
    "camera.width=48",
    "camera.height=48",
    "scenes.train=2",
    "scenes.validation=0",
    "scenes.test=1",
    "collect.steps=16",
    "seed_model.checkpoint=null",
    "seed_model.steps=6",
    "training.steps=6",
    "training.validations=1",
    "evaluation.viewpoints=2",
]


@pytest.fixture(scope="session")
def smallest_arguments():
    """The arguments of the smallest experiment: smallest_arguments(outputs, *overrides)."""

    def make(outputs: Path, *overrides: str) -> list[str]:
        return [*SMALLEST, f"paths.outputs={outputs}", f"hydra.run.dir={outputs}/run", *overrides]

    return make


@pytest.fixture(scope="session")
def command(smallest_arguments):
    """The command line of the smallest experiment, with further overrides: command(outputs, "explore=random", ...)."""

    def make(outputs: Path, *overrides: str) -> list[str]:
        return [sys.executable, "-m", "deux", *smallest_arguments(outputs, *overrides)]

    return make


@pytest.fixture(scope="session")
def experiment(command):
    """Run the smallest experiment to its end: experiment(outputs, *overrides) gives the finished process."""

    def run(outputs: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(command(outputs, *overrides), capture_output=True, text=True)

    return run


@pytest.fixture(scope="session")
def finished(experiment, tmp_path_factory) -> Path:
    """The outputs folder of an uninterrupted experiment with deux."""
    outputs = tmp_path_factory.mktemp("uninterrupted")
    process = experiment(outputs, "explore=deux")
    assert process.returncode == 0, process.stderr
    return outputs


TINY = [
    "camera.width=48",
    "camera.height=48",
    "scenes.train=1",
    "scenes.validation=0",
    "scenes.test=1",
    "collect.steps=8",
    "seed_model.checkpoint=null",
    "seed_model.steps=2",
    "training.steps=2",
    "training.validations=1",
    "evaluation.viewpoints=3",
    "trainer.accelerator=cpu",
    "foundation.scenes=1",
    "foundation.viewpoints=3",
    "foundation.steps=2",
]
"""As little as every stage can do."""


SMALL_MODELS = {
    "kbnet": {"image_filters": (4, 8, 8, 8, 8), "depth_filters": (4,) * 5, "decoder_filters": (8, 8, 8, 8, 4)},
    "voiced": {"image_filters": (4, 8, 8, 8, 8), "depth_filters": (4,) * 5, "decoder_filters": (8,) * 4},
    "scaffnet": {"filters": (4, 4, 8, 8, 8), "decoder_filters": (8, 8, 8, 8, 4)},
    "fusionnet": {
        "image_filters": (4, 8, 8, 8, 8),
        "depth_filters": (4,) * 5,
        "decoder_filters": (8, 8, 8, 8, 4),
        "scaffnet_filters": (4, 4, 8, 8, 8),
        "scaffnet_decoder_filters": (8, 8, 8, 8, 4),
    },
}
"""Options that make each shipped depth model a small one."""


@dataclass(frozen=True)
class Outcome:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def sentence(self) -> str:
        """What a user reads of a mistake: all of stderr, which is one line."""
        assert self.code == 1, self.err
        assert self.err.startswith("deux: "), self.err
        assert self.err.count("\n") == 1, self.err
        return self.err.removeprefix("deux: ").rstrip("\n")


@pytest.fixture(scope="session")
def deux(command_line):
    """Run the command line inside this process, on one thread: deux(*arguments).

    Figures are written, but blank unless `figures` is true.
    """

    def run(*arguments: str, figures: bool = False) -> Outcome:
        out, err, threads = io.StringIO(), io.StringIO(), torch.get_num_threads()
        torch.set_num_threads(1)  # on images as small as these, more of them only wait for each other
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
            if not any(argument == "-m" or argument.startswith("experiment=") for argument in arguments):
                # Hydra would compose everything once more, to see whether a file asks for a sweep.
                patch.setattr(Hydra, "get_mode", lambda *_, **__: None)
            if not figures:
                patch.setattr(Figure, "draw", lambda *_, **__: None)  # layout takes longer than training
            code = command_line(*arguments)
        torch.set_num_threads(threads)
        return Outcome(code, out.getvalue(), err.getvalue())

    return run


@pytest.fixture(scope="session")
def tiny_arguments():
    """The arguments of a command that does next to nothing: tiny_arguments(outputs, *overrides, model="kbnet")."""

    def make(outputs: Path, *overrides: str, model: str = "kbnet") -> list[str]:
        scenes = "scenes=files" in overrides
        small = [setting for setting in TINY if not (scenes and setting.startswith("scenes."))]
        network = [f"model.{name}={list(value)}" for name, value in SMALL_MODELS.get(model, {}).items()]
        return [*small, f"model={model}", *network, f"paths.outputs={outputs}", *overrides]

    return make


@pytest.fixture(scope="session")
def tiny(deux, tiny_arguments):
    """Run such a command inside this process: tiny(outputs, *overrides, model="kbnet", figures=False)."""

    def run(outputs: Path, *overrides: str, model: str = "kbnet", figures: bool = False) -> Outcome:
        return deux(*tiny_arguments(outputs, *overrides, model=model), figures=figures)

    return run


@pytest.fixture(scope="session")
def collected(tiny, tmp_path_factory) -> Path:
    """The outputs folder in which `task=collect explore=random` ran."""
    outputs = tmp_path_factory.mktemp("tiny")
    outcome = tiny(outputs, "task=collect", "explore=random", f"hydra.run.dir={outputs}/collected")
    assert (outcome.code, outcome.err) == (0, "")
    return outputs


@pytest.fixture(scope="session")
def trained(tiny, collected) -> Path:
    """The same folder once `task=train` has left a model in its folder `trained`."""
    outcome = tiny(collected, "task=train", "explore=random", f"hydra.run.dir={collected}/trained")
    assert (outcome.code, outcome.err) == (0, "")
    return collected


@pytest.fixture(scope="session")
def tested(tiny, trained) -> Path:
    """The same folder once `task=evaluate` has made the test frames and left its results in its folder `tested`."""
    folders = [f"evaluation.checkpoint={trained}/trained", f"hydra.run.dir={trained}/tested"]
    outcome = tiny(trained, "task=evaluate", *folders)
    assert (outcome.code, outcome.err) == (0, "")
    return trained


@pytest.fixture(scope="session")
def model_file(tmp_path_factory) -> Callable[[str], Path]:
    """Write a small model with random weights, always the same: model_file("kbnet") gives its file."""
    folder = tmp_path_factory.mktemp("models")

    def write(name: str) -> Path:
        path = folder / f"{name}.safetensors"
        if not path.exists():
            with torch.random.fork_rng():
                torch.manual_seed(0)
                model = registry().create("depth_models", name, SMALL_MODELS[name])
            save_model(path, model, name, SMALL_MODELS[name])
        return path

    return write


class Wall(DepthModel):
    """A model that brings its weights, and needs no training as it predicts one distance everywhere."""

    pretrained = True
    min_depth, max_depth = 0.1, 10.0

    def __init__(self, distance: float = 2.0) -> None:
        super().__init__()
        self.distance = distance  # no weight of torch's at all

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(torch.zeros_like(sparse_depth) + self.distance)


@pytest.fixture
def wall() -> Iterator[str]:
    """The name of a depth model that brings its weights."""
    registry().register("depth_models", "wall", Wall)
    yield "wall"
    registry().unregister("depth_models", "wall")


@pytest.fixture(scope="session")
def room(tmp_path_factory) -> Callable[..., Path]:
    """Write a coloured room of 4 m x 2.5 m x 4 m as a .glb: room(name, "floor", "walls", "furniture")."""
    folder = tmp_path_factory.mktemp("scenes")
    walls = [((4, 2.5, 0.1), (0, 1.25, side)) for side in (-2.05, 2.05)]
    walls += [((0.1, 2.5, 4), (side, 1.25, 0)) for side in (-2.05, 2.05)]
    boxes = {
        "floor": [((4, 0.1, 4), (0, -0.05, 0))],
        "walls": walls,
        "furniture": [((0.5, 0.8, 0.5), (1, 0.4, 1)), ((0.4, 1.6, 0.4), (-1.2, 0.8, 0.5))],
    }

    def write(name: str, *parts: str) -> Path:
        scene = trimesh.Scene()
        for number, (extents, centre) in enumerate(box for part in parts for box in boxes[part]):
            mesh = trimesh.creation.box(extents).apply_translation(centre).subdivide().subdivide()
            colors = np.random.default_rng(number).integers(40, 255, (len(mesh.faces), 3))
            mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=colors)
            scene.add_geometry(mesh)
        path = folder / f"{name}.glb"
        scene.export(path)
        return path

    return write
