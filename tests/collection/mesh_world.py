"""Rooms in .obj files that know who has loaded them, and explorers that fail, for jobs on other machines."""

import os
import signal
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from toy_world import CAMERA, ROBOT, ToyScene, ToySimulator, Wanderer

from deux.contracts import Action, Observation, Scene, SceneReference
from deux.errors import DeuxError
from deux.mesh_files.mesh_reader import read_mesh
from deux.scenes.mesh_scene import mesh_scene
from deux.simulator.mesh_simulator import MeshSimulator


@dataclass(frozen=True)
class RoomFile(SceneReference):
    """A room in a file; each load adds the number of its process to `loads.txt` beside the file."""

    path: Path

    @property
    def identity(self) -> str:
        return f"room:{self.path.name}"

    @property
    def file(self) -> Path:
        return self.path

    def load(self) -> Scene:
        if not self.path.exists():
            raise DeuxError(f"there is no scene file {self.path}.")
        with (self.path.parent / "loads.txt").open("a") as file:
            print(self.path.stem, os.getpid(), file=file)
        return replace(mesh_scene(self.name, read_mesh(self.path), self.identity, str(self.path)))


def write_room(folder: Path, name: str, seed: int) -> RoomFile:
    """A box of 4 x 3 m with a texture on it."""
    room = trimesh.creation.box(bounds=[[0, 0, 0], [4, 2.5, 3]])
    pixels = np.random.default_rng(seed).integers(0, 256, (16, 16, 3), np.uint8)
    Image.fromarray(pixels).save(folder / f"{name}.png")
    (folder / f"{name}.mtl").write_text(f"newmtl a\nmap_Kd {name}.png\n")
    lines = [f"v {x} {y} {z}\nvt {x} {y + z}" for x, y, z in room.vertices]
    lines += ["usemtl a", *("f " + " ".join(f"{v}/{v}" for v in face) for face in room.faces + 1)]
    (folder / f"{name}.obj").write_text(f"mtllib {name}.mtl\n" + "\n".join(lines))
    return RoomFile(name, path=folder / f"{name}.obj")


def mesh_room(scene: SceneReference) -> MeshSimulator:
    return MeshSimulator(scene, CAMERA, ROBOT)


def signed_room(folder: Path, scene: ToyScene) -> ToySimulator:
    """A toy room that leaves its name and the number of the process that made it in a folder."""
    folder.mkdir(exist_ok=True)
    (folder / f"{scene.name} {os.getpid()}").touch()
    return ToySimulator(scene, delay=0.05)


def slow_toy(scene: ToyScene) -> ToySimulator:
    return ToySimulator(scene, delay=0.05)


class Mistaken(Wanderer):
    """Finds a user's mistake at its third step."""

    def act(self, observation: Observation) -> Action:
        if observation.step == 2:
            raise DeuxError("the robot has no battery: charge it.")
        return super().act(observation)


class Deadly(Wanderer):
    """Ends its process at its third step, as the system does where memory runs out."""

    def act(self, observation: Observation) -> Action:
        if observation.step == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)
