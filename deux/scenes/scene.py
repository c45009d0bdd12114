"""A place that a robot can explore."""

from dataclasses import dataclass

from deux.scenes.mesh import SceneMesh


@dataclass(frozen=True)
class Scene:
    """A mesh, and what is known about it.

    Args:
        name: short name, unique within a dataset; names the sequences recorded here.
        mesh: geometry, appearance and labels.
        floor_height: world y of the main floor, metres.
        identity: what made the scene (generator version and seed, or a file's content hash); equal identities mean
            equal scenes, so it is part of a dataset's key.
    """

    name: str
    mesh: SceneMesh
    floor_height: float
    identity: str
