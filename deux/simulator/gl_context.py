"""Off-screen OpenGL contexts of moderngl by EGL, on a GPU or, with Mesa, on the CPU."""

from __future__ import annotations

import weakref
from types import ModuleType
from typing import TYPE_CHECKING

from deux.errors import DeuxError
from deux.simulator.egl_context import REMEDY, check_not_forked, load_triton, remember_process

if TYPE_CHECKING:
    import moderngl

_VERSION = 430  # for indirect multi-draw; supported by Mesa and all drivers of the last ten years


def load_moderngl() -> ModuleType:
    """Import moderngl.

    Raises:
        DeuxError: it is not installed.
    """
    try:
        import moderngl
    except ImportError as cause:
        raise DeuxError(
            'simulator.renderer=gl needs the package moderngl: pip install "deux[gl]", '
            "or set simulator.renderer=embree."
        ) from cause
    module: ModuleType = moderngl
    return module


class GLContext:
    """An OpenGL context that is current only inside `with`, so that any thread may use it, one at a time.

    Its objects are freed with the context, or by garbage collection.

    Raises:
        DeuxError: moderngl or the system's OpenGL libraries are missing, a context cannot be created, or this process
            was forked from one that has a context.
    """

    def __init__(self) -> None:
        check_not_forked("gl")
        moderngl = load_moderngl()
        load_triton()
        try:
            self.gl = moderngl.create_context(standalone=True, backend="egl", require=_VERSION)
        # glcontext raises plain exceptions.
        except Exception as cause:
            raise DeuxError(f"simulator.renderer=gl cannot make an EGL context ({cause}): {REMEDY}") from cause
        remember_process()
        self.on_cpu = any(name in self.gl.info["GL_RENDERER"] for name in ("llvmpipe", "softpipe"))
        self.gl.gc_mode = "context_gc"  # objects that are deleted outside `with` are freed by the next `with`
        self.gl.__exit__(None, None, None)
        weakref.finalize(self, _release, self.gl).atexit = False

    def __enter__(self) -> moderngl.Context:
        self.gl.__enter__()
        self.gl.gc()
        return self.gl

    def __exit__(self, *error: object) -> None:
        self.gl.__exit__(None, None, None)


def _release(gl: moderngl.Context) -> None:
    gl.__enter__()
    gl.gc()
    gl.release()
