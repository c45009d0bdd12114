import pytest
import torch

from deux.bench.installed_plugins import default_model, installed, make_guide, renderers
from deux.contracts import SceneReference, Uncertainty
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.robot import Robot
from deux.registry import registry
from deux.testing.box_world import BoxWorld


@pytest.mark.usefixtures("tiny_models")
def test_what_cannot_be_made_without_options_is_left_out() -> None:
    made, notes = installed("depth_models")
    assert list(made) == ["tiny"]
    assert len(notes) == 1
    assert notes[0].startswith("demanding is left out: ")


@pytest.mark.usefixtures("tiny_models")
def test_the_default_model_is_the_first_that_can_be_made_and_needs_no_ground_truth() -> None:
    assert default_model() == "tiny"  # "demanding" comes first but has an option without a default


@pytest.mark.usefixtures("tiny_models")
def test_the_guide_predicts_and_judges() -> None:
    guide = make_guide(None)
    assert guide is not None
    assert guide.name == "tiny"
    assert isinstance(guide.uncertainty, Uncertainty)
    device = guide.predict_depth.device
    image, points = torch.rand(2, 3, 8, 8, device=device), torch.ones(2, 1, 8, 8, device=device)
    assert guide.predict_depth(image, points, torch.eye(3, device=device).repeat(2, 1, 1)).shape == (2, 1, 8, 8)


@pytest.mark.usefixtures("tiny_models")
def test_there_is_no_guide_where_no_model_is_installed() -> None:
    registry().unregister("depth_models", "tiny")
    assert make_guide(None) is None
    with pytest.raises(DeuxError, match="no depth model called 'tiny'"):
        make_guide("tiny")


class Boxes(BoxWorld):
    """A room of 4 m x 4 m, made as a simulator is."""

    def __init__(self, scene: SceneReference, camera: Camera, robot: Robot, colors: bool = True) -> None:
        super().__init__(4.0, 4.0, camera=camera, robot=robot)


def test_every_installed_simulator_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    names = registry().names("simulators")  # fills the table, so that it comes back afterwards
    monkeypatch.setitem(registry()._plugins, "simulators", list(registry()._plugins["simulators"]))
    registry().register("simulators", "boxes", Boxes)
    assert list(renderers())[:3] == ["embree", "gl", "pyrender"]
    assert set(renderers()) == {"embree", "gl", "pyrender", "boxes", *names} - {"mesh"}
    assert renderers()["pyrender"].description == {"name": "mesh", "renderer": "pyrender"}
