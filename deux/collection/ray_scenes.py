"""Scenes that lie in files of one machine, for the other machines of a Ray cluster."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import ray
from ray.exceptions import RayTaskError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from deux.contracts import Scene, SceneReference
from deux.errors import DeuxError
from deux.scenes.prepared_scene import pyramid_textures

_LOADS_AT_A_TIME = 4


@dataclass(frozen=True)
class SentScene(SceneReference):
    """A scene that is loaded on the machine of its files and fetched from there, once by each machine.

    The arrays of the scene that `load` returns lie in memory that the processes of a machine share, and are read-only.
    Simulators that read the file themselves find it only where the machines share their storage.

    Args:
        name: the scene's name.
        original: the reference that loads it where the files are.
        made_from: its identity, known without the files.
        store: the actor made of `SceneStore`.
    """

    original: SceneReference
    made_from: str
    store: Any = field(compare=False, repr=False)

    @property
    def identity(self) -> str:
        """As of the original."""
        return self.made_from

    @property
    def file(self) -> Path | None:
        """As of the original."""
        return self.original.file

    @property
    def up(self) -> Literal["y", "z"]:
        """As of the original."""
        return self.original.up

    @property
    def scale(self) -> float:
        """As of the original."""
        return self.original.scale

    def load(self) -> Scene:
        """Fetch the scene, which is loaded now unless another worker has asked for it before.

        Raises:
            DeuxError: it cannot be loaded.
        """
        try:
            (kept,) = ray.get(self.store.scene.remote(self.original))
            scene: Scene = ray.get(kept)
        except RayTaskError as error:
            if isinstance(error.cause, DeuxError):
                raise error.cause from None
            raise
        return _with_textures(scene)


class SceneStore:
    """Loads scenes into Ray's object store, each once. An actor on the machine of the files is made of it."""

    def __init__(self) -> None:
        self._guard = Lock()
        self._locks: dict[SceneReference, Lock] = {}
        self._kept: dict[SceneReference, Any] = {}

    def scene(self, reference: SceneReference) -> list[Any]:
        """The scene's place in the object store, in a list, without which Ray would send the scene itself.

        Raises:
            DeuxError: it cannot be loaded.
        """
        with self._guard:
            lock = self._locks.setdefault(reference, Lock())
        with lock:
            if reference not in self._kept:
                self._kept[reference] = ray.put(_without_textures(reference.load()))
            return [self._kept[reference]]

    def forget(self, reference: SceneReference) -> None:
        """Give the scene's memory back as soon as no worker uses it."""
        self._kept.pop(reference, None)


class SceneSender:
    """Replaces references to scenes in files by such as work on every machine of the cluster.

    Args:
        scenes: those of all jobs, one for each episode.
    """

    def __init__(self, scenes: Sequence[SceneReference]) -> None:
        self._episodes = Counter(scenes)
        self._sent: dict[SceneReference, SentScene] = {}
        self._store: Any = None
        if any(scene.file is not None for scene in scenes):
            here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
            actor = ray.remote(SceneStore).options(
                num_cpus=0,
                max_concurrency=_LOADS_AT_A_TIME,
                max_restarts=-1,
                max_task_retries=-1,
                scheduling_strategy=here,
            )
            self._store = actor.remote()

    def sent(self, scene: SceneReference) -> SceneReference:
        """The reference that a worker gets; a scene in no file is made on the worker's machine."""
        if scene.file is None:
            return scene
        if scene not in self._sent:
            self._sent[scene] = SentScene(scene.name, scene, scene.identity, self._store, area=scene.area)
        return self._sent[scene]

    def done(self, scene: SceneReference) -> None:
        """Note that an episode in the scene is over; after the last one its memory is given back."""
        self._episodes[scene] -= 1
        if scene in self._sent and not self._episodes[scene]:
            self._store.forget.remote(scene)

    def close(self) -> None:
        """End the process that loads scenes."""
        if self._store is not None:
            ray.kill(self._store)


def _without_textures(scene: Scene) -> Scene:
    """The scene without the textures that its mip pyramids hold too."""
    mesh = scene.mesh
    if mesh.pyramids is None:
        return scene
    numbers = mesh.pyramids.material_texture.tolist()
    pairs = zip(mesh.materials, numbers, strict=True)
    bare = tuple(material if number < 0 else replace(material, texture=None) for material, number in pairs)
    return replace(scene, mesh=replace(mesh, materials=bare))


def _with_textures(scene: Scene) -> Scene:
    mesh = scene.mesh
    if mesh.pyramids is None:
        return scene
    return replace(scene, mesh=replace(mesh, materials=pyramid_textures(mesh.materials, mesh.pyramids)))
