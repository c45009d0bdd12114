"""Sends scenes in files of one machine to the other machines of a Ray cluster."""

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
from deux.scenes.loaded_scene import loaded_scene
from deux.scenes.prepared_scene import pyramid_textures

_LOADS_AT_A_TIME = 4


@dataclass(frozen=True)
class SentScene(SceneReference):
    """A scene that is loaded on the machine that has its files, and fetched once by each other machine.

    The arrays of the loaded scene are read-only and in memory that the processes of a machine share. Simulators that
    read the file themselves need shared storage.

    Args:
        name: the scene's name.
        original: the reference that loads it on the machine of its files.
        made_from: its identity, so that the files are not needed.
        store: Ray actor of `SceneStore`.
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
        """Fetch the scene; it is loaded now unless another worker has requested it before.

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
    """Loads scenes into Ray's object store, each once. It runs as an actor on the machine of the files."""

    def __init__(self) -> None:
        self._guard = Lock()
        self._locks: dict[SceneReference, Lock] = {}
        self._kept: dict[SceneReference, Any] = {}

    def scene(self, reference: SceneReference) -> list[Any]:
        """A reference to the scene in the object store; in a list, since Ray would otherwise resolve it.

        Raises:
            DeuxError: it cannot be loaded.
        """
        with self._guard:
            lock = self._locks.setdefault(reference, Lock())
        with lock:
            if reference not in self._kept:
                self._kept[reference] = ray.put(_without_textures(loaded_scene(reference)))
            return [self._kept[reference]]

    def forget(self, reference: SceneReference) -> None:
        """Free the scene's memory as soon as no worker uses it."""
        self._kept.pop(reference, None)


class SceneSender:
    """Replaces references to scenes in files by ones that work on every machine of the cluster.

    Args:
        scenes: the scenes of all jobs, one for each episode.
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
        """The reference to send to a worker; a scene without a file is generated on the worker's machine."""
        if scene.file is None:
            return scene
        if scene not in self._sent:
            self._sent[scene] = SentScene(scene.name, scene, scene.identity, self._store, area=scene.area)
        return self._sent[scene]

    def done(self, scene: SceneReference) -> None:
        """Note the end of an episode in the scene; after the last one, its memory is freed."""
        self._episodes[scene] -= 1
        if scene in self._sent and not self._episodes[scene]:
            self._store.forget.remote(scene)

    def close(self) -> None:
        """End the process that loads scenes."""
        if self._store is not None:
            ray.kill(self._store)


def _without_textures(scene: Scene) -> Scene:
    """The scene without the textures that are also in its mip pyramids."""
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
