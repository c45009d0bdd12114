"""The scene dataset configuration that tells Habitat-Sim how to read one scene file."""

import json
from pathlib import Path
from typing import Any

from deux.contracts import SceneReference
from deux.errors import DeuxError

CONFIG_SUFFIX = ".scene_dataset_config.json"

# `up` and `front` of the file, in its own axes, for Habitat-Sim's `up` and `front` keys.
AXES: dict[str, tuple[list[float], list[float]]] = {
    "y": ([0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
    "z": ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
}

# Suffixes of what lies beside a scene, after the name that the files share: its semantic mesh and the description of
# its objects. HM3D's mesh has the objects' colours as textures; MP3D's and Gibson's have an object's number per face.
SEMANTICS = (
    (".semantic.glb", (".semantic.txt",)),
    ("_semantic.ply", (".house", ".scn")),
)


def scene_file(scene: SceneReference) -> Path:
    """The file of a scene, which Habitat-Sim reads itself.

    Raises:
        DeuxError: the scene is in no file, or in one that is not in metres: Habitat-Sim makes its navmesh from the file
            as it is, whatever a configuration says of its scale.
    """
    if scene.file is None:
        raise DeuxError(
            f"the scene {scene.name} is in no file, and simulator=habitat reads scene files itself: take scenes=files, "
            "or another simulator."
        )
    if scene.scale != 1.0:
        raise DeuxError(
            f"simulator=habitat reads files in metres, and a unit of {scene.file} is {scene.scale:g} m: write the file "
            "again in metres, or take simulator=mesh."
        )
    return scene.file


def write_config(scene: SceneReference, folder: Path) -> Path:
    """Write a configuration with one stage, the scene's file, into a folder.

    It says what Habitat-Sim gets wrong when it has to guess:

    - `up` and `front`. Without a configuration every file is taken for a Z-up one, and a Y-up house lies on its side.
    - `semantic_up` and `semantic_front`. Habitat-Sim's reader of `_semantic.ply` already turns it to Y-up, and turns it
      a second time unless these say that it is.
    - Surfaces show their colours as they are stored: flat shading, no lights.

    Args:
        scene: a scene in a file.
        folder: an existing folder; it must stay until the scene is loaded.

    Returns:
        The file that was written.
    """
    file = scene_file(scene)
    up, front = AXES[scene.up]
    attributes = {
        "shader_type": "flat",
        "up": up,
        "front": front,
        "origin": [0.0, 0.0, 0.0],
        **_semantic_attributes(file, scene.up),
    }
    config = {
        "stages": {"paths": {file.suffix: [str(file)]}, "default_attributes": attributes},
        "scene_instances": {"default_attributes": {"default_lighting": "no_lights"}},
    }
    path = folder / f"scene{CONFIG_SUFFIX}"
    path.write_text(json.dumps(config, indent=1))
    return path


def check_config(path: str) -> Path:
    """The absolute path of a scene dataset configuration that the user names.

    Raises:
        DeuxError: there is no such file, or its name does not end as Habitat-Sim requires.
    """
    config = Path(path).expanduser().absolute()
    if not config.name.endswith(CONFIG_SUFFIX):
        raise DeuxError(f"simulator.dataset is {path}: the name of such a file ends in {CONFIG_SUFFIX}.")
    if not config.is_file():
        raise DeuxError(f"simulator.dataset is {path}: there is no such file.")
    return config


def _semantic_attributes(file: Path, up: str) -> dict[str, Any]:
    """The keys of the semantic mesh and the description that lie beside a scene; none where either is missing."""
    stem = file.name.removesuffix(file.suffix).removesuffix(".basis")
    for mesh_suffix, descriptions in SEMANTICS:
        mesh = file.with_name(stem + mesh_suffix)
        found = [path for path in (file.with_name(stem + suffix) for suffix in descriptions) if path.is_file()]
        if not mesh.is_file() or not found:
            continue
        turned = mesh.suffix == ".ply"
        semantic_up, semantic_front = AXES["y" if turned else up]
        return {
            "semantic_asset": str(mesh),
            "semantic_descriptor_filename": str(found[0]),
            "semantic_up": semantic_up,
            "semantic_front": semantic_front,
            "has_semantic_textures": not turned,
        }
    return {}
