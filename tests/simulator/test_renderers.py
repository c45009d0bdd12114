import sys

import numpy as np
import pytest

from deux.contracts import Scene
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.simulator.embree_renderer import EmbreeRenderer
from deux.simulator.renderers import make_renderer


def test_renderers_are_made_by_name(box: Scene) -> None:
    assert isinstance(make_renderer("embree", box.mesh, Camera()), EmbreeRenderer)


def test_an_unknown_renderer_is_named_with_what_was_meant(box: Scene) -> None:
    with pytest.raises(DeuxError, match=r"renderer cannot be 'embre': did you mean embree\? .*pyrender"):
        make_renderer("embre", box.mesh, Camera())


def test_missing_opengl_is_one_sentence_with_the_packages(box: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deux.simulator.egl_context.NO_PYRENDER", (4, 0))
    monkeypatch.setitem(sys.modules, "pyrender", None)  # makes its import fail
    with pytest.raises(DeuxError, match=r"cannot load OpenGL .*Debian packages libegl1 and libgl1"):
        make_renderer("pyrender", box.mesh, Camera())


def test_pyrender_is_refused_where_python_is_too_new_for_it(box: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deux.simulator.egl_context.NO_PYRENDER", (3, 11))
    with pytest.raises(
        DeuxError, match=r"pyrender does not work with Python 3\.11 or later, .* set simulator.renderer=gl"
    ):
        make_renderer("pyrender", box.mesh, Camera())


def test_a_missing_moderngl_is_one_sentence_with_the_command(box: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moderngl", None)
    with pytest.raises(DeuxError, match=r'renderer=gl needs the package moderngl: pip install "deux\[gl\]", or set'):
        make_renderer("gl", box.mesh, Camera())


def test_missing_opengl_is_reported_for_gl_too(box: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    moderngl = pytest.importorskip("moderngl")

    def fail(**settings: object) -> None:
        raise Exception("libEGL.so not loaded")

    monkeypatch.setattr(moderngl, "create_context", fail)
    with pytest.raises(DeuxError, match=r"cannot make an EGL context .*Debian packages libegl1 and libgl1"):
        make_renderer("gl", box.mesh, Camera()).render(np.eye(4)[None])
