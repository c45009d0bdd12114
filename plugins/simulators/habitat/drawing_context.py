"""The OpenGL context in which all Habitat-Sims of a process draw, and the one thread that opens and frees them."""

from __future__ import annotations

import atexit
import functools
import weakref
from collections import deque
from types import ModuleType
from typing import Any

from deux.geometry.camera import Camera

NEAR, FAR = 0.01, 1000.0  # metres: the clipping planes that Habitat-Sim has by default


@functools.cache
def drawing_context(habitat: ModuleType, device: int) -> DrawingContext:
    """The context of this process; made once, on the device that is asked for first."""
    return DrawingContext(habitat, device)


class DrawingContext:
    """The context, held by an empty Habitat-Sim until the process ends, and the scenes that are open in it.

    Two things end the process without a Python exception, so they are kept from happening:

    - All Habitat-Sims draw in the context of the first one. It must not be freed while another one draws.
    - A Habitat-Sim must be freed in the thread that opened it. Python's collector of garbage runs in any thread, so it
      only notes what nobody uses; that is freed before the next picture or scene.

    Args:
        habitat: the package.
        device: `gpu_device_id`.
    """

    def __init__(self, habitat: ModuleType, device: int) -> None:
        self._habitat = habitat
        self._open: dict[int, Any] = {}
        self._discarded: deque[int] = deque()
        backend = habitat.SimulatorConfiguration()
        backend.scene_id = "NONE"
        backend.gpu_device_id = device
        backend.enable_physics = False
        agent = habitat.AgentConfiguration()
        agent.sensor_specifications = [sensor_spec(habitat, "DEPTH", Camera(1, 1))]
        self._holder = habitat.Simulator(habitat.Configuration(backend, [agent]))
        atexit.register(self._close)

    def open(self, configuration: Any, user: object) -> Any:
        """Open a Habitat-Sim.

        Args:
            configuration: Habitat-Sim's own.
            user: once this object is gone, the Habitat-Sim is freed.
        """
        self.free_discarded()
        simulator = self._habitat.Simulator(configuration)
        self._open[id(simulator)] = simulator
        weakref.finalize(user, self._discarded.append, id(simulator))
        return simulator

    def free_discarded(self) -> None:
        """Free what nobody uses any more; call it in the thread that opens scenes."""
        while self._discarded:
            self._open.pop(self._discarded.popleft()).close()

    def _close(self) -> None:
        """Free all scenes and the context last, before the interpreter would free them in any order."""
        self._discarded.clear()
        while self._open:
            self._open.popitem()[1].close()
        self._holder.close()


def sensor_spec(habitat: ModuleType, kind: str, camera: Camera, near: float = NEAR, far: float = FAR) -> Any:
    """The specification of one sensor at the agent's origin; its name tells all its properties.

    Args:
        habitat: the package.
        kind: a name in Habitat-Sim's `SensorType`.
        camera: its size and field of view.
        near: nearest depth in metres that is drawn.
        far: farthest depth in metres that is drawn.
    """
    spec = habitat.CameraSensorSpec()
    spec.uuid = f"{kind.lower()}_{camera.width}x{camera.height}_{camera.hfov}_{near}_{far}"
    spec.sensor_type = getattr(habitat.SensorType, kind)
    spec.sensor_subtype = habitat.SensorSubType.PINHOLE
    spec.resolution = [int(camera.height), int(camera.width)]
    spec.hfov = float(camera.hfov)
    spec.near, spec.far = float(near), float(far)
    # Lists of integers raise TypeError.
    spec.position = [0.0, 0.0, 0.0]
    spec.orientation = [0.0, 0.0, 0.0]
    return spec
