"""The specification of a dataset: everything that determines its content, and the hash that names it."""

import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from deux.broken_contracts import broken_contract
from deux.collection.sparse import SparseSettings
from deux.collection.verification import VerificationSettings
from deux.contracts import Explorer, SceneArea, SceneReference
from deux.errors import kind_of
from deux.registry import PluginChoice
from deux.scenes.splits import identity_of
from deux.simulator.simulation import Simulation

DATASET_VERSION = 6
"""Incremented by every code change that changes datasets."""

VIEWPOINTS = "viewpoints"
"""In place of an explorer's name: free poses spread uniformly over the scenes, for evaluation or as an upper bound."""

IDEAL_SOURCES = {"sources": "ideal"}
"""Settings of `VIEWPOINTS` for source frames chosen by true depth around each viewpoint: the upper bound."""

Split = Literal["train", "validation", "test"]


@dataclass(frozen=True)
class DatasetSpec:
    """Specifies a dataset.

    Args:
        name: short name, the first part of the dataset's folder name.
        scenes: the scenes, each with `name`, `identity` and `area`.
        explorer: the explorer's registered name, or `VIEWPOINTS`.
        simulation: simulator, camera and robot.
        steps: actions, and so frames, of an episode; for `VIEWPOINTS` the number of viewpoints on each floor.
        episodes: episodes on each floor of each scene; a scene has one floor unless its `area` asks for all.
        sparse: number of sparse points of a frame.
        verification: which frames are rejected.
        seed: seed of the starts, the explorers and the viewpoints.
        model: identity of the depth model that guides the explorer, or None.
        uncertainty: uncertainty measure of that model's predictions (Eq. 8), or None.
        correct_depth: whether the explorer receives that model's depth corrected by the sparse points.
        remembered_frames: number of earlier frames whose points correct it as well.
        batch_size: number of episodes that run in lock-step (`collect.batch_size`).
        split: the prefix of the list files.
        explorer_settings: all the explorer's options, defaults included; JSON values only.
    """

    name: str
    scenes: tuple[SceneReference, ...]
    explorer: str
    simulation: Simulation
    steps: int
    explorer_settings: Mapping[str, Any] = field(default_factory=dict)
    episodes: int = 1
    sparse: SparseSettings = field(default_factory=SparseSettings)
    verification: VerificationSettings = field(default_factory=VerificationSettings)
    seed: int = 0
    model: str | None = None
    uncertainty: PluginChoice | None = None
    correct_depth: bool = False
    remembered_frames: int = 0
    batch_size: int = 4
    split: Split = "train"

    def description(self) -> dict[str, Any]:
        """The specification as JSON values, for the hash and the manifest."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "simulation"}
        if self.remembered_frames == 0:
            del values["remembered_frames"]  # so that datasets from before this option keep their hash
        return {
            "version": DATASET_VERSION,
            **values,
            **self.simulation.description(),
            "scenes": [
                {"name": scene.name, "identity": identity_of(scene), "area": _plain(scene.area)}
                for scene in self.scenes
            ],
            "explorer_settings": dict(self.explorer_settings),
            "uncertainty": self.uncertainty and self.uncertainty.description,
            "sparse": asdict(self.sparse),
            "verification": asdict(self.verification),
        }

    def key(self) -> str:
        """Hash of the specification, twelve hexadecimal digits."""
        canonical = json.dumps(self.description(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()[:12]

    @property
    def folder_name(self) -> str:
        """Name of the dataset's folder."""
        return f"{self.name}-{self.key()}"

    def episode_seed(self, scene: SceneReference, episode: int) -> int:
        """Seed of one episode, which depends only on seed, scene and number: all explorers start at the same poses."""
        return episode_seed(self.seed, scene, episode)


def episode_seed(seed: int, scene: SceneReference, episode: int) -> int:
    """Seed of one episode, which depends only on the run's seed, the scene and the episode's number in it."""
    return zlib.crc32(f"{seed}/{identity_of(scene)}/{episode}".encode())


def fingerprint_of(explorer: Explorer) -> str | None:
    """The `Explorer.fingerprint` of an explorer, for `DatasetSpec.explorer_settings`.

    Raises:
        DeuxError: it is not text or None.
    """
    found: object = explorer.fingerprint()
    if found is None or isinstance(found, str):
        return found
    raise broken_contract(explorer, kind_of(found), "text, such as a hash, or None", "fingerprint")


def _plain(area: SceneArea) -> dict[str, Any]:
    """An area as JSON values."""
    return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(area).items()}


def place_name(scene: SceneReference, floor: int) -> str:
    """The name of one floor of a scene, under which its frames are stored; for the main floor, the scene's name."""
    return scene.name if floor == 0 else f"{scene.name}-floor{floor}"


def scene_of_place(place: str) -> str:
    """The scene of a `place_name`.

    Example:
        >>> scene_of_place("house_1-floor2"), scene_of_place("house_1")
        ('house_1', 'house_1')
    """
    return re.sub(r"(-floor\d+)+$", "", place)  # twice if the scene's own name ends like that


def place_of_sequence(sequence: str) -> str:
    """The `place_name` of a collected sequence: its name without the number of the episode or viewpoint.

    Example:
        >>> place_of_sequence("house_1-floor1-02"), place_of_sequence("house_1-view0012")
        ('house_1-floor1', 'house_1')
    """
    return re.sub(r"-(view)?\d+$", "", sequence)
