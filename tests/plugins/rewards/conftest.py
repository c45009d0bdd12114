"""Experiences that are small enough to be judged by hand."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from deux.contracts import Episode, Experience, Observation, Robot
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose

CAMERA = Camera(4, 4)


def experience(
    x: float = 0.0,
    z: float = 0.0,
    action: int | None = 0,
    occupancy: Any = ((0,),),
    views: Any = ((0,),),
    seen: Any = ((False,),),
    resolution: float = 0.1,
    view: Any = None,
    **observed: Any,
) -> Experience:
    """A robot at (x, z) that looks along -Z, and what it then knows; whatever is not given is empty."""
    occupancy = np.array(occupancy, np.int8)
    frame = GridFrame(0.0, 0.0, *occupancy.shape, resolution)
    observation = Observation(0, camera_pose(x, 1.25, z, 0.0), False, np.zeros((4, 4, 3), np.uint8), **observed)
    return Experience(
        observation, action, frame, occupancy, np.array(views, np.int32), np.array(seen, bool), view or {}
    )


@pytest.fixture
def make_experience() -> Callable[..., Experience]:
    return experience


@pytest.fixture
def make_episode() -> Callable[..., Episode]:
    """A function from label names to an episode with a camera of 4 x 4 pixels."""
    return lambda *names, steps=10: Episode(0, steps, CAMERA, Robot(), label_names=names)
