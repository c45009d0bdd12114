from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from deux.bench import render_speed
from deux.bench.render_speed import RenderSettings, measure_rendering
from deux.bench.timing import Spread
from deux.errors import DeuxError
from deux.simulator import mesh_simulator

TINY = RenderSettings(sizes=(16, 24), processes=(1, 2), triangles=14_000, rounds=2, seconds=0.01, poses=4)


@pytest.mark.slow
def test_every_renderer_is_measured_in_every_way(monkeypatch: pytest.MonkeyPatch) -> None:
    def in_this_process(work: Callable[..., Any], job: object, processes: int, opengl_threads: int) -> list[Any]:
        return [work(job, lambda: None)] * processes

    monkeypatch.setattr(render_speed, "at_once", in_this_process)
    (table,) = measure_rendering(TINY, None)
    rows = [row for row in table.rows if row["renderer"] == "embree"]
    ways = [(row["processes"], row["pixels"]) for row in rows]
    assert ways == [(1, "16 x 16"), (1, "24 x 24"), (2, "16 x 16"), (2, "24 x 24")] * 2
    assert rows[0]["triangles"] < rows[4]["triangles"] == pytest.approx(14_000, abs=2)  # type: ignore[operator]
    for row in table.rows:
        assert isinstance(row["frames per second"], Spread)
        assert row["frames per second"].low > 0.0
        assert isinstance(row["times the slowest"], Spread)
    left_out = [note for note in table.notes if note.startswith(("gl is left out: ", "pyrender is left out: "))]
    assert len(table.rows) == 8 * (3 - len(left_out))


def test_a_renderer_without_its_libraries_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def make_renderer(name: str, *rest: Any) -> Any:
        if name != "embree":
            raise DeuxError("there is no EGL.")
        return original(name, *rest)

    original = mesh_simulator.make_renderer
    monkeypatch.setattr(mesh_simulator, "make_renderer", make_renderer)
    monkeypatch.setattr(render_speed, "at_once", lambda work, job, processes, threads: [work(job, lambda: None)])
    (table,) = measure_rendering(RenderSettings((16,), (1,), 14_000, 1, 0.01, 2), None)
    assert [row["renderer"] for row in table.rows] == ["embree", "embree"]
    assert {"gl is left out: there is no EGL.", "pyrender is left out: there is no EGL."} <= set(table.notes)


def test_a_scene_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"missing\.glb"):
        list(measure_rendering(TINY, tmp_path / "missing.glb"))
