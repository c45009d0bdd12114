"""Prepared scenes: a cache on disk of the arrays of loaded scenes, which are memory-mapped."""

import hashlib
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from deux.contracts import Floor, Material, Scene, SceneMesh
from deux.errors import DeuxError, error_text
from deux.geometry.texture_pyramids import TexturePyramids
from deux.io.atomic import write_failure
from deux.io.json_files import read_json_object
from deux.scenes.loaded_scene import check_scene

log = logging.getLogger(__name__)

VERSION = 2
"""Increase this with every change of the mesh readers or of the floor detection, to invalidate the cache."""

_ARRAYS = ("vertices", "faces", "uv", "face_material", "face_label", "vertex_colors")
_DESCRIPTION = "scene.json"


def prepared_scene(folder: Path | None, identity: str, make: Callable[[], Scene]) -> Scene:
    """Open a scene from the cache; if it is not there, load it and add it first.

    A prepared scene takes about 100 bytes for each triangle and 4 bytes for each texel. Its folder, which is created
    atomically, is named after its identity and the version of the format. Its arrays are memory-mapped: pages that no
    frame needs are not read, and all processes of a machine share the others. If the folder cannot be written, a
    warning is logged and the loaded scene is returned.

    Args:
        folder: the cache folder; None for no cache.
        identity: see `SceneReference`; it includes all options that change the scene.
        make: loads the scene.

    Raises:
        DeuxError: the scene cannot be loaded, or the prepared scene is damaged.
    """
    if folder is None:
        return make()
    place = folder / hashlib.sha256(f"{VERSION} {identity}".encode()).hexdigest()[:16]
    if not (place / _DESCRIPTION).is_file():
        scene = make()
        check_scene(scene, f"the scene {scene.name}")
        try:
            _write(scene, place)
        except OSError as error:
            log.warning("The scene %s is not prepared: %s", scene.name, write_failure(folder, error))
            return scene
        size = sum(file.stat().st_size for file in place.iterdir())
        log.info("The scene %s is prepared in %s, which takes %d MB.", scene.name, place, size // 1_000_000)
        del scene  # frees its memory before the prepared scene is opened
    try:
        return _open(place)
    except Exception as error:  # a damaged array or description, of any kind
        raise DeuxError(f"the prepared scene {place} is damaged ({error_text(error)}): delete the folder.") from error


def _write(scene: Scene, place: Path) -> None:
    """Write all arrays to a temporary folder, then rename it."""
    mesh = scene.mesh
    place.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{place.name}.", dir=place.parent))
    try:
        for name in _ARRAYS:
            if (array := getattr(mesh, name)) is not None:
                np.save(temporary / f"{name}.npy", array)
        if mesh.pyramids is not None:
            for name, array in mesh.pyramids._asdict().items():
                np.save(temporary / f"pyramids_{name}.npy", array)
        description = {
            "name": scene.name,
            "identity": scene.identity,
            "floors": [asdict(floor) for floor in scene.floors],
            "materials": [{"name": m.name, "color": m.color} for m in mesh.materials],
            "label_names": mesh.label_names,
            "origin": mesh.origin,
        }
        (temporary / _DESCRIPTION).write_text(json.dumps(description))
        temporary.chmod(0o755)  # mkdtemp creates folders that other users cannot read
        os.rename(temporary, place)
    except OSError:
        if not (place / _DESCRIPTION).is_file():  # otherwise another process has prepared the same scene
            raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _open(place: Path) -> Scene:
    description = read_json_object(place / _DESCRIPTION)
    pyramids = None
    if (place / "pyramids_texels.npy").is_file():
        pyramids = TexturePyramids(*(_mapped(place / f"pyramids_{name}.npy") for name in TexturePyramids._fields))
    materials = tuple(Material(entry["name"], tuple(entry["color"])) for entry in description["materials"])
    if pyramids is not None:
        materials = pyramid_textures(materials, pyramids)
    arrays = {name: _mapped(place / f"{name}.npy") for name in _ARRAYS if (place / f"{name}.npy").is_file()}
    x, y, z = description["origin"]
    mesh = SceneMesh(
        **arrays,
        materials=materials,
        label_names=tuple(description["label_names"]),
        origin=(x, y, z),
        pyramids=pyramids,
    )
    floors = tuple(Floor(**floor) for floor in description["floors"])
    return Scene(description["name"], mesh, floors, description["identity"])


def pyramid_textures(materials: Sequence[Material], pyramids: TexturePyramids) -> tuple[Material, ...]:
    """The materials with the textures of the mip pyramids, as views."""
    shown = [pyramids.texture(k) for k in range(len(pyramids.sizes))]
    pairs = zip(materials, pyramids.material_texture.tolist(), strict=True)
    return tuple(material if k < 0 else replace(material, texture=shown[k]) for material, k in pairs)


def _mapped(path: Path) -> np.ndarray:
    """Memory-map the array in a file (copy-on-write)."""
    if np.load(path, mmap_mode="r").size == 0:  # empty arrays cannot be mapped
        return np.load(path)
    return np.load(path, mmap_mode="c").view(np.ndarray)
