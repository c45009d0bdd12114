"""A source of scenes: rectangular rooms furnished with boxes, made from a seed."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import trimesh

from deux.contracts import Floor, Material, Scene, SceneMesh, SceneReference, SceneSource, SceneSplits
from deux.errors import check_range

VERSION = 1
"""Version of the generator: raised whenever any seed gives another room than before."""

HEIGHT = 2.5
"""Height of the rooms, metres."""

PASSAGE = 0.8
"""Least distance between two pieces of furniture along x or z, metres."""

FURNITURE = {"table": (1.2, 0.75, 0.8), "bed": (1.4, 0.5, 2.0), "cabinet": (0.5, 2.0, 1.0)}
"""Mean sizes along x, y and z in metres, by label."""

LABEL_NAMES = ("floor", "ceiling", "wall", *FURNITURE)


@dataclass(frozen=True)
class BoxRoomReference(SceneReference):
    """The locator of a room: what its generator is seeded with.

    Args:
        name: the scene's name.
        series: 0 for training, 1 for validation, 2 for testing, 3 for further rooms.
        number: the number of the room in its series.
        furniture: number of pieces that are placed, where there is room for them.
    """

    series: int
    number: int
    furniture: int

    @property
    def identity(self) -> str:
        """The generator's version and all that it is given."""
        return f"box_room:{VERSION}:{self.series}:{self.number}:{self.furniture}"

    def load(self) -> Scene:
        """Generate the room."""
        rng = np.random.default_rng([self.series, self.number])
        width, length = rng.uniform(4.0, 7.0, size=2)
        pieces = _furnish(rng, width, length, self.furniture)
        area = float(width * length - sum(np.prod(piece.box.extents[[0, 2]]) for piece in pieces))
        mesh = _mesh(rng, [*_shell(width, length), *pieces])
        return Scene(self.name, mesh, (Floor(0.0, area),), self.identity)


class BoxRooms(SceneSource):
    """Rooms of 16 to 49 square metres, each with some boxes that are labelled as furniture.

    Args:
        train: number of rooms that are explored.
        validation: number of rooms for model selection.
        test: number of rooms for the final evaluation.
        furniture: number of pieces of furniture in each room; fewer where they do not fit.
    """

    def __init__(self, train: int = 4, validation: int = 1, test: int = 2, furniture: int = 5) -> None:
        self._counts = {"train": train, "validation": validation, "test": test}
        for name, count in (*self._counts.items(), ("furniture", furniture)):
            check_range(f"scenes.{name}", count, 0)
        self._furniture = furniture

    def splits(self) -> SceneSplits:
        """The rooms of each split; each split has a series of its own, so that none shares a room with another."""
        rooms = {
            split: tuple(self._reference(series, number) for number in range(count))
            for series, (split, count) in enumerate(self._counts.items())
        }
        return SceneSplits(**rooms)

    def further(self, count: int, without: Collection[str]) -> tuple[SceneReference, ...]:
        """Rooms of a fourth series."""
        rooms = [self._reference(3, number) for number in range(count + len(without))]
        return tuple([room for room in rooms if room.identity not in without][:count])

    def _reference(self, series: int, number: int) -> BoxRoomReference:
        return BoxRoomReference(f"box_room_{series}_{number:04d}", series, number, self._furniture)


class _Piece(NamedTuple):
    """A part of a scene: its triangles, and the label of them all."""

    box: trimesh.Trimesh
    label: str


def _shell(width: float, length: float) -> list[_Piece]:
    """Floor, ceiling and walls: the sides of one box, told apart by their normals."""
    box = _box((width, HEIGHT, length), width / 2, length / 2)
    up = box.face_normals[:, 1]
    sides = {"floor": up < -0.5, "ceiling": up > 0.5, "wall": np.abs(up) < 0.5}
    return [_Piece(trimesh.Trimesh(box.vertices, box.faces[faces]), label) for label, faces in sides.items()]


def _furnish(rng: np.random.Generator, width: float, length: float, count: int) -> list[_Piece]:
    """Boxes at random places of a room, at least `PASSAGE` apart; what fits nowhere in 20 tries is left out."""
    pieces: list[_Piece] = []
    for label in rng.choice(list(FURNITURE), size=count):
        size = rng.uniform(0.8, 1.2, size=3) * FURNITURE[label]
        for _ in range(20):
            x, z = rng.uniform(size[[0, 2]] / 2, (width, length) - size[[0, 2]] / 2)
            box = _box(size, x, z)
            if all(_apart(box, other.box) >= PASSAGE for other in pieces):
                pieces.append(_Piece(box, str(label)))
                break
    return pieces


def _box(size: np.ndarray | tuple[float, float, float], x: float, z: float) -> trimesh.Trimesh:
    """A box that stands on the floor with its middle at world (x, z), metres."""
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix((x, size[1] / 2, z)))


def _apart(first: trimesh.Trimesh, second: trimesh.Trimesh) -> float:
    """Gap in metres between two axis-aligned boxes along x or z, whichever is larger; negative where they overlap."""
    (low, high), (other_low, other_high) = first.bounds, second.bounds
    return float(np.maximum(low - other_high, other_low - high)[[0, 2]].max())


def _mesh(rng: np.random.Generator, pieces: list[_Piece]) -> SceneMesh:
    """All pieces as one mesh, each in a colour of its own under one texture of random squares of 10 cm."""
    texture = np.repeat(rng.integers(128, 256, (10, 10, 1), dtype=np.uint8), 3, axis=2)
    colors = rng.integers(80, 256, (len(pieces), 3)).tolist()
    whole = trimesh.util.concatenate([piece.box for piece in pieces])
    assert isinstance(whole, trimesh.Trimesh)
    counts = [len(piece.box.faces) for piece in pieces]
    # The texture lies flat on every side: its coordinates are metres along the two axes that are not the normal's.
    others = np.array([[2, 1], [0, 2], [0, 1]])[np.abs(whole.face_normals).argmax(axis=1)]
    return SceneMesh(
        vertices=whole.vertices.astype(np.float32),
        faces=whole.faces.astype(np.int32),
        uv=np.take_along_axis(whole.triangles, others[:, None], axis=2).astype(np.float32),
        face_material=np.repeat(np.arange(len(pieces), dtype=np.int32), counts),
        materials=tuple(
            Material(piece.label, tuple(color), texture) for piece, color in zip(pieces, colors, strict=True)
        ),
        face_label=np.repeat(np.array([LABEL_NAMES.index(piece.label) for piece in pieces], np.int32), counts),
        label_names=LABEL_NAMES,
    )
