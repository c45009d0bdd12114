import gc
import threading
import weakref
from collections.abc import Callable
from types import ModuleType

import numpy as np

from deux.contracts import DEPTH, Robot, SceneReference
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux_plugins.simulators.habitat import HabitatSimulator
from deux_plugins.simulators.habitat.drawing_context import drawing_context

CAMERA = Camera(32, 24)
POSE = camera_pose(3.0, 1.25, 2.5, 0.3)[None]


def test_a_scene_that_is_done_with_takes_nothing_from_the_others(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    install()
    first = HabitatSimulator(make_room(), CAMERA, Robot())
    second = HabitatSimulator(make_room("z"), CAMERA, Robot())
    seen = first.observe(DEPTH, POSE)[0].depth
    del first
    gc.collect()
    np.testing.assert_allclose(second.observe(DEPTH, POSE)[0].depth, seen, atol=1e-5)


def test_what_is_collected_in_another_thread_is_freed_in_this_one(
    install: Callable[..., ModuleType], make_room: Callable[..., SceneReference]
) -> None:
    habitat = install()
    first = HabitatSimulator(make_room(), CAMERA, Robot())
    second = HabitatSimulator(make_room(), CAMERA, Robot())
    backend = weakref.ref(first._shared.session._simulator)
    first.itself = first  # type: ignore[attr-defined]  # garbage that only the collector finds
    del first
    thread = threading.Thread(target=gc.collect)
    thread.start()
    thread.join()
    assert backend() is not None, "it was freed in the other thread"
    second.observe(DEPTH, POSE)
    gc.collect()
    assert backend() is None, "it is never freed"
    assert drawing_context(habitat, -1) is second._shared.session._context
