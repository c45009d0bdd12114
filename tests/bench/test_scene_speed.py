import pytest

from deux.bench import scene_speed
from deux.bench.bench_scenes import flats
from deux.bench.scene_speed import SceneSettings, measure_scenes
from deux.bench.timing import Spread
from deux.contracts import SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError


class Made(SceneSource):
    """A source that makes scenes."""

    def splits(self) -> SceneSplits:
        raise AssertionError("scenes of the splits may be on disk")

    def further(self, count: int, without: object) -> tuple[SceneReference, ...]:
        return flats(count)


class Stored(Made):
    """A source that makes none."""

    def further(self, count: int, without: object) -> tuple[SceneReference, ...]:
        raise DeuxError("there are no more.")


def test_what_is_measured_is_what_the_scenes_are(monkeypatch: pytest.MonkeyPatch) -> None:
    sources = {"made": Made(), "stored": Stored()}
    monkeypatch.setattr(scene_speed, "installed", lambda kind: (sources, ("odd is left out: it is broken.",)))
    (table,) = measure_scenes(SceneSettings(size=16, scenes=2))
    (row,) = table.rows
    assert row["source"] == "made"
    scenes = [reference.load() for reference in flats(2)]
    assert row["triangles"] == Spread.of([len(scene.mesh.faces) for scene in scenes])
    assert row["square metres"] == Spread.of([scene.floors[0].area for scene in scenes])
    texels = [sum({id(m.texture): m.texture.nbytes for m in s.mesh.materials}.values()) for s in scenes]
    assert isinstance(row["MB"], Spread)
    assert min(texels) / 1e6 < row["MB"].low < 2.0 * max(texels) / 1e6
    times = [row[column] for column in ("make (s)", "free floor (s)", "first image (s)")]
    assert all(isinstance(time, Spread) and time.low > 0.0 for time in times)
    assert table.notes == ("odd is left out: it is broken.", "stored is left out: there are no more.")
