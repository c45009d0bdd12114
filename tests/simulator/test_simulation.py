import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from deux.contracts import Robot, Scene, SceneReference
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.mesh_simulator import MeshSimulator
from deux.simulator.simulation import Simulation


def simulation(**options: str) -> Simulation:
    return Simulation(Camera(32, 24), Robot(radius=0.2), registry().choose("simulators", {"name": "mesh", **options}))


def test_it_makes_the_simulator_that_is_chosen_here_and_elsewhere(
    box: Scene, refer: Callable[[Scene], SceneReference]
) -> None:
    for made_by in (simulation(), pickle.loads(pickle.dumps(simulation()))):
        made = made_by.make(refer(box))
        assert isinstance(made, MeshSimulator)
        assert (made.camera, made.robot, made.scene) == (Camera(32, 24), Robot(radius=0.2), refer(box))


def test_its_description_is_json_that_names_all_that_frames_depend_on() -> None:
    description = json.loads(json.dumps(simulation().description()))
    assert description["simulator"] == {"name": "mesh", "renderer": "embree"}
    assert (description["camera"]["width"], description["robot"]["radius"]) == (32, 0.2)
    assert simulation(renderer="pyrender").description() != simulation().description()


def test_an_unknown_renderer_is_refused_before_a_scene_is_loaded() -> None:
    with pytest.raises(DeuxError, match=r"simulator\.renderer cannot be 'embre': did you mean embree"):
        simulation(renderer="embre")


class Paced(MeshSimulator):
    """Asks a scene for what no other package's has."""

    def __init__(self, scene: Any, camera: Camera, robot: Robot, colors: bool = True) -> None:
        scene.paces()


def test_a_scene_of_another_package_that_it_cannot_open_is_told(box: Scene) -> None:
    @dataclass(frozen=True)
    class Strange(SceneReference):
        identity = "strange"

    own: dict[str, Any] = {"__name__": "scenery.places"}
    exec("def paces(self): raise ValueError('a mistake of its own')", own)
    pacing = type("Pacing", (Strange,), {"paces": own["paces"]})
    registry().register("simulators", "paced", Paced)
    try:
        chosen = Simulation(Camera(32, 24), Robot(), registry().choose("simulators", {"name": "paced"}))
        with pytest.raises(AttributeError, match="'Strange' object has no attribute 'paces'"):
            chosen.make(Strange("s"))  # of the simulator's own package
        for scene in (Strange, pacing):
            scene.__module__ = "scenery.places"
        sentence = (
            r"^the simulator 'paced' of registered by hand .* cannot open the scene s, a Strange of scenery "
            r"\(AttributeError: 'Strange' object has no attribute 'paces'\): choose one of the scenes that it is"
        )
        with pytest.raises(DeuxError, match=sentence):
            chosen.make(Strange("s"))
        with pytest.raises(ValueError, match="a mistake of its own"):
            chosen.make(pacing("s"))
    finally:
        registry().unregister("simulators", "paced")
