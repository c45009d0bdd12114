"""Off-screen rendering of pyrender scenes by EGL, with corrections of what pyrender 0.1.45 gets wrong."""

import os
import sys
import weakref
from contextlib import suppress
from ctypes import ArgumentError
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np

from deux.errors import DeuxError

REMEDY = "install the Debian packages libegl1 and libgl1, or set simulator.renderer=embree."
"""What a user can do who has no OpenGL."""

NO_PYRENDER = (3, 12)
"""The first version of Python with which pyrender draws no textures."""

_creator: int | None = None
"""The process that made the first context."""


def check_not_forked(renderer: str) -> None:
    """Refuse to use OpenGL in a process that was forked from one that has a context.

    Mesa would wait forever for threads that the fork has left behind.

    Args:
        renderer: the name of the renderer that is about to use it.

    Raises:
        DeuxError: this process was forked so.
    """
    if _creator not in (None, os.getpid()):
        raise DeuxError(
            f"simulator.renderer={renderer} was used before this process was forked: start worker processes by spawn, "
            "or set simulator.renderer=embree."
        )


def remember_process() -> None:
    """Note that this process has an OpenGL context."""
    global _creator
    _creator = os.getpid()


def load_triton() -> None:
    """Load torch's compiler before OpenGL.

    torch loads it with its first optimizer. It has an LLVM of its own, as Mesa has, and loading it after Mesa's crashes
    the process.
    """
    with suppress(ImportError):
        import triton._C.libtriton  # noqa: F401


def load_pyrender() -> ModuleType:
    """Import pyrender for use without a screen.

    Raises:
        DeuxError: the system's OpenGL libraries are missing, or Python is too new for pyrender.
    """
    if sys.version_info >= NO_PYRENDER:
        least = ".".join(map(str, NO_PYRENDER))
        raise DeuxError(
            f"simulator.renderer=pyrender does not work with Python {least} or later, because of PyOpenGL 3.1.0, which "
            "pyrender 0.1.45 asks for: set simulator.renderer=gl or simulator.renderer=embree."
        )
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    load_triton()
    # pyrender imports its viewer too, and that needs a library of X11 unless pyglet is told that there is no screen.
    os.environ.setdefault("PYGLET_HEADLESS", "true")
    try:
        import pyrender
    # What a missing library raises depends on which one it is: PyOpenGL looks up names in the None that it loaded.
    except (ImportError, AttributeError) as cause:
        raise DeuxError(f"simulator.renderer=pyrender cannot load OpenGL ({cause}): {REMEDY}") from cause
    module: ModuleType = pyrender
    return module


class EGLContext:
    """An OpenGL context without a window. It belongs to the thread that made it.

    Used in place of `pyrender.OffscreenRenderer`, which when it is deleted shuts down the display that every other
    context of the process needs.

    Args:
        width: width of the image in pixels.
        height: height of the image in pixels.

    Raises:
        DeuxError: the machine offers no such context, or this process was forked from one that has a context.
    """

    def __init__(self, width: int, height: int) -> None:
        check_not_forked("pyrender")
        pyrender = load_pyrender()
        from OpenGL.error import Error
        from OpenGL.GL import GL_UNPACK_ALIGNMENT, glPixelStorei
        from pyrender.platforms.egl import EGLPlatform

        try:
            self._platform = EGLPlatform(width, height)
            self._platform.init_context()
            # pyrender hands over textures without padding, but OpenGL expects rows of a multiple of four bytes.
            glPixelStorei(GL_UNPACK_ALIGNMENT, 1)
            self._renderer = pyrender.Renderer(width, height)
        except (AssertionError, IndexError, ArgumentError, Error) as cause:
            raise DeuxError(f"simulator.renderer=pyrender cannot make an EGL context ({cause!r}): {REMEDY}") from cause
        remember_process()
        weakref.finalize(self, _release, self._platform, self._renderer).atexit = False

    def render(self, scene: Any) -> tuple[np.ndarray, np.ndarray]:
        """Draw a `pyrender.Scene` unlit, both sides of each face.

        Returns:
            H x W x 3 uint8, and H x W float32 metres, 0 = none.

        Raises:
            DeuxError: the driver refuses to draw.
        """
        from OpenGL.error import Error
        from OpenGL.GL import glRenderbufferStorage
        from pyrender import RenderFlags

        # pyrender draws with four samples a pixel and keeps the depth of the first, which is off the pixel's centre by
        # (-0.125, +0.375): millimetres on slanted surfaces. One sample lies at the centre.
        def single_sample(target: int, samples: int, storage: int, width: int, height: int) -> None:
            glRenderbufferStorage(target, storage, width, height)

        self._platform.make_current()
        flags = RenderFlags.OFFSCREEN | RenderFlags.FLAT | RenderFlags.SKIP_CULL_FACES
        try:
            with patch("pyrender.renderer.glRenderbufferStorageMultisample", single_sample):
                color, depth = self._renderer.render(scene, flags)
        except (ArgumentError, Error) as cause:
            # These errors hold pointers and cannot be sent from a worker process.
            said = " ".join(str(cause).split())
            raise DeuxError(
                f"OpenGL refuses to draw ({said}): set simulator.renderer=gl or simulator.renderer=embree."
            ) from cause
        return np.ascontiguousarray(color), np.ascontiguousarray(depth)


def _release(platform: Any, renderer: Any) -> None:
    """Free a context and what lies in it, but leave the display to the others."""
    from OpenGL.EGL import eglDestroyContext

    platform.make_current()
    renderer.delete()
    eglDestroyContext(platform._egl_display, platform._egl_context)
