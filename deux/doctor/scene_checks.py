"""Checks of a configuration's scenes: their files, and a description of the first scene."""

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from omegaconf import DictConfig

from deux.contracts import Robot, Scene, SceneFiles, SceneReference, SceneSource, SceneSplits, Simulator
from deux.doctor.checkup import Checkup
from deux.errors import DeuxError, counted
from deux.geometry.camera import Camera
from deux.options import construct
from deux.registry import registry
from deux.scenes.objects import find_objects
from deux.scenes.splits import SPLITS, splits_of
from deux.simulator.simulation import Simulation

T = TypeVar("T")

LISTED = 3
"""Number of scenes of a split whose missing files are printed."""


def check_scenes(checkup: Checkup, cfg: DictConfig, load: bool) -> None:
    """Report which scenes are on disk; a missing scene that the configuration uses is a fault.

    Args:
        checkup: the report.
        cfg: the composed configuration.
        load: whether the first scene of the configuration is loaded and described.
    """
    checkup.heading(f"Scenes: {cfg.scenes.get('name')}")
    try:
        source: SceneSource = registry().choose("scenes", cfg.scenes).create()
        splits, fault = _splits(source)
        inventory = source.inventory()
    except DeuxError as error:
        checkup.fault(str(error))
        return
    _print_inventory(checkup, inventory, splits)
    if fault:
        checkup.fault(fault)
    if load:
        _check_first_scene(checkup, cfg, splits)


def _splits(source: SceneSource) -> tuple[SceneSplits | None, str]:
    """The scenes of the configuration, or None and the error, if the source's inventory does not depend on them."""
    try:
        return splits_of(source), ""
    except DeuxError as error:
        if type(source).inventory is SceneSource.inventory:
            raise  # the default inventory depends on the splits
        return None, str(error)


def _print_inventory(
    checkup: Checkup, inventory: dict[str, tuple[SceneFiles, ...]], splits: SceneSplits | None
) -> None:
    rows = []
    for split in SPLITS:
        scenes = inventory.get(split, ())
        complete = [scene for scene in scenes if not scene.missing]
        size = sum(path.stat().st_size for scene in scenes for path in scene.files)
        asked = "?" if splits is None else str(len(getattr(splits, split)))
        rows.append((split, str(len(scenes)), str(len(complete)), f"{size / 2**30:.2f}", asked))
    checkup.table(("split", "scenes", "on disk", "GiB", "asked for"), rows)
    for split in SPLITS:
        scenes = inventory.get(split, ())
        for what, faults in (
            ("missing", [f"{scene.name}: {fault}" for scene in scenes for fault in scene.missing]),
            ("without", [f"{s.name}: {' and '.join(s.without)}" for s in scenes if s.without and not s.missing]),
        ):
            _print_some(checkup, f"{split} {what}", faults)


def _print_some(checkup: Checkup, name: str, lines: Sequence[str]) -> None:
    for line in lines[:LISTED]:
        checkup.fact(name, line)
    if len(lines) > LISTED:
        checkup.fact(name, f"and {len(lines) - LISTED} more")


def _check_first_scene(checkup: Checkup, cfg: DictConfig, splits: SceneSplits | None) -> None:
    references: list[SceneReference] = [] if splits is None else [*splits.train, *splits.validation, *splits.test]
    if not references:
        checkup.fault("--load describes the first scene that is asked for, but there is none.")
        return
    first = references[0]
    checkup.heading(f"Scene {first.name}")
    try:
        simulation = Simulation(
            construct(Camera, cfg.camera, "camera"),
            construct(Robot, cfg.robot, "robot"),
            registry().choose("simulators", cfg.simulator),
        )
        _describe_mesh(checkup, first)
        simulator, seconds = _timed(lambda: simulation.make(first))
        checkup.fact("simulator", f"{simulation.simulator.name}, made in {seconds:.1f} s")
        _describe_floors(checkup, simulator)
    except DeuxError as error:
        checkup.fault(str(error))


def _describe_mesh(checkup: Checkup, reference: SceneReference) -> None:
    try:
        scene, seconds = _timed(reference.load)
    except DeuxError as error:
        if reference.file is None:
            raise
        checkup.fact("mesh", f"not read: {error}")  # the simulator may read the file itself
        return
    mesh = scene.mesh
    textures = {id(texture): texture for m in mesh.materials if (texture := m.texture) is not None}
    pixels = sum(texture.shape[0] * texture.shape[1] for texture in textures.values())
    low, high = mesh.bounds.astype(float)
    checkup.fact("read in", f"{seconds:.1f} s")
    checkup.fact("triangles", f"{len(mesh.faces):,}")
    checkup.fact("colours", _colours(scene, len(textures), pixels))
    checkup.fact("extent", " x ".join(f"{length:.1f}" for length in high - low) + " m (x, height, z)")
    checkup.fact("labels", _labels(scene))


def _colours(scene: Scene, textures: int, pixels: int) -> str:
    vertex_colors = "vertex colours" if scene.mesh.vertex_colors is not None else ""
    size = f"{pixels / 1e6:.1f} Mpx, {pixels * 3 / 2**30:.2f} GiB decoded"
    images = f"{counted(textures, 'texture')}, {size}" if textures else ""
    return " and ".join(filter(None, (images, vertex_colors))) or "none but base colours"


def _labels(scene: Scene) -> str:
    mesh = scene.mesh
    labelled = mesh.face_label >= 0
    if not labelled.any():
        return "none: no objects are counted, and rewards that need labels cannot be trained for here"
    used = len(np.unique(mesh.face_label[labelled]))
    objects = len(find_objects(mesh).labels)
    return f"{100 * labelled.mean():.0f} % of the triangles, {counted(used, 'kind')}, {counted(objects, 'object')}"


def _describe_floors(checkup: Checkup, simulator: Simulator) -> None:
    for k, floor in enumerate(simulator.floors):
        text = f"at height {floor.height:.2f} m, {floor.area:.1f} m2 level"
        try:
            space = simulator.free_space(k)
        except DeuxError as error:
            text += f"; {error}"
            if len(simulator.floors) == 1:
                checkup.fault(str(error))
        else:
            text += f", room for the robot on {space.free.sum() * space.frame.resolution**2:.1f} m2"
        checkup.fact("floor", text)  # without its index, since scenes.floor counts all floors from the lowest


def _timed(action: Callable[[], T]) -> tuple[T, float]:
    """Call a function; returns its result and its duration in seconds."""
    start = time.perf_counter()
    return action(), time.perf_counter() - start
