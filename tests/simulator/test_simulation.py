import json
import pickle
from collections.abc import Callable

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
