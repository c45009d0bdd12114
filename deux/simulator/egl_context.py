"""Off-screen rendering of pyrender scenes by EGL, with workarounds for errors of pyrender 0.1.45."""

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
"""The advice in messages if OpenGL is missing."""

NO_PYRENDER = (3, 12)
"""The first version of Python in which pyrender does not work."""

_creator: int | None = None
"""The id of the process that created the first context."""


def check_not_forked(renderer: str) -> None:
    """Raise DeuxError in a process that was forked from one with an OpenGL context.

    Mesa would wait forever for threads that do not exist in the forked process.

    Args:
        renderer: the name of the renderer, for the message.
    """
    if _creator not in (None, os.getpid()):
        raise DeuxError(
            f"simulator.renderer={renderer} was used before this process was forked: start worker processes by spawn, "
            "or set simulator.renderer=embree."
        )


def remember_process() -> None:
    """Record that this process has an OpenGL context; see `check_not_forked`."""
    global _creator
    _creator = os.getpid()


def load_triton() -> None:
    """Load Triton before OpenGL.

    Torch would load it with its first optimizer. Triton and Mesa both contain LLVM, and loading Triton's after Mesa's
    crashes the process.
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
            "pyrender 0.1.45 requires: set simulator.renderer=gl or simulator.renderer=embree."
        )
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    load_triton()
    # pyrender imports its viewer, which needs an X11 library unless pyglet is in headless mode.
    os.environ.setdefault("PYGLET_HEADLESS", "true")
    try:
        import pyrender
    # The error depends on the missing library: PyOpenGL raises AttributeError for some of them.
    except (ImportError, AttributeError) as cause:
        raise DeuxError(f"simulator.renderer=pyrender cannot load OpenGL ({cause}): {REMEDY}") from cause
    module: ModuleType = pyrender
    return module


class EGLContext:
    """An off-screen OpenGL context, to be used only by the thread that created it.

    It replaces `pyrender.OffscreenRenderer`, whose deletion terminates the EGL display of all contexts in the process.

    Args:
        width: width of the image in pixels.
        height: height of the image in pixels.

    Raises:
        DeuxError: a context cannot be created, or this process was forked from one that has a context.
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
            # pyrender uploads textures without padding, but OpenGL's default alignment of rows is four bytes.
            glPixelStorei(GL_UNPACK_ALIGNMENT, 1)
            self._renderer = pyrender.Renderer(width, height)
        except (AssertionError, IndexError, ArgumentError, Error) as cause:
            raise DeuxError(f"simulator.renderer=pyrender cannot make an EGL context ({cause!r}): {REMEDY}") from cause
        remember_process()
        weakref.finalize(self, _release, self._platform, self._renderer).atexit = False

    def render(self, scene: Any) -> tuple[np.ndarray, np.ndarray]:
        """Render a `pyrender.Scene` unlit and without face culling.

        Returns:
            H x W x 3 uint8, and H x W float32 metres, 0 = none.

        Raises:
            DeuxError: OpenGL reports an error.
        """
        from OpenGL.error import Error
        from OpenGL.GL import glRenderbufferStorage
        from pyrender import RenderFlags

        # pyrender renders four samples per pixel and returns the depth of the first, which is (-0.125, +0.375) pixels
        # away from the pixel's centre: an error of millimetres on slanted surfaces. A single sample is at the centre.
        def single_sample(target: int, samples: int, storage: int, width: int, height: int) -> None:
            glRenderbufferStorage(target, storage, width, height)

        self._platform.make_current()
        flags = RenderFlags.OFFSCREEN | RenderFlags.FLAT | RenderFlags.SKIP_CULL_FACES
        try:
            with patch("pyrender.renderer.glRenderbufferStorageMultisample", single_sample):
                color, depth = self._renderer.render(scene, flags)
        except (ArgumentError, Error) as cause:
            # These errors contain pointers and cannot be pickled by a worker process.
            reason = " ".join(str(cause).split())
            raise DeuxError(
                f"OpenGL cannot render ({reason}): set simulator.renderer=gl or simulator.renderer=embree."
            ) from cause
        return np.ascontiguousarray(color), np.ascontiguousarray(depth)


def _release(platform: Any, renderer: Any) -> None:
    """Free a context and its objects, but not the display, which other contexts use."""
    from OpenGL.EGL import eglDestroyContext

    platform.make_current()
    renderer.delete()
    eglDestroyContext(platform._egl_display, platform._egl_context)
