"""`task=collect collect.viewer=rerun`: recordings of episodes, also of a dataset that was there before."""

import pytest

from deux.contracts import Action
from deux_plugins.explorers.random import RandomExplorer


def test_the_episodes_of_a_dataset_that_is_there_are_recorded(tiny, collected):
    pytest.importorskip("rerun")
    run = collected / "watched"
    outcome = tiny(collected, "task=collect", "explore=random", "collect.viewer=rerun", f"hydra.run.dir={run}")
    assert (outcome.code, outcome.err) == (0, "")
    assert "collected before" in outcome.out
    (recording,) = (run / "recordings").iterdir()
    assert f"Recording: {recording}" in outcome.out
    assert recording.stat().st_size > 1000


def test_a_recording_ends_where_the_explorer_goes_another_way(tiny, collected, monkeypatch):
    """As where a card predicts a frame differently alone; everything else is written."""
    pytest.importorskip("rerun")
    run = collected / "diverged"
    choose = RandomExplorer.act
    monkeypatch.setattr(RandomExplorer, "act", lambda self, seen: choose(self, seen) if seen.step < 4 else Action.LEFT)
    outcome = tiny(collected, "task=collect", "explore=random", "collect.viewer=rerun", f"hydra.run.dir={run}")
    assert outcome.code == 0
    assert "-00 cannot be replayed beyond step" in outcome.err
    assert (run / "scorecard.json").exists()
    assert [path.suffix for path in (run / "recordings").iterdir()] == [".rrd"]
