"""`task=collect collect.viewer=rerun`: recordings of episodes, also of a dataset that was there before."""

import pytest


def test_the_episodes_of_a_dataset_that_is_there_are_recorded(tiny, collected):
    pytest.importorskip("rerun")
    run = collected / "watched"
    outcome = tiny(collected, "task=collect", "explore=random", "collect.viewer=rerun", f"hydra.run.dir={run}")
    assert (outcome.code, outcome.err) == (0, "")
    assert "collected before" in outcome.out
    (recording,) = (run / "recordings").iterdir()
    assert f"Recording: {recording}" in outcome.out
    assert recording.stat().st_size > 1000
