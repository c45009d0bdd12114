import time

import numpy as np
import pytest

from deux.bench import peer_figures
from deux.bench.peer_figures import Peer, PeerSettings, Work, measure_peers
from deux.bench.timing import Spread
from deux.mapping.planning import path_length

TINY = PeerSettings(rounds=1, seconds=0.01)


def test_a_line_for_each_peer_with_the_ratio_of_its_time_to_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    def ours() -> None:
        time.sleep(0.01)

    work = Work("sleeping", ours, [Peer("recorded", 100.0), Peer("measured", call=lambda: time.sleep(0.04))])
    timed = Work("told", lambda: 5.0, [Peer("recorded", 10.0)], timed=True)
    for part in ("_drawing", "_planning", "_points", "_files", "_learning", "_models"):
        found = {"_planning": [work], "_files": [timed]}.get(part, [])
        monkeypatch.setattr(peer_figures, part, lambda *_, found=found: iter(found))
    (table,) = measure_peers(TINY, None)
    assert [(row["work"], row["peer"]) for row in table.rows] == [
        ("sleeping", "recorded"),
        ("sleeping", "measured"),
        ("told", "recorded"),
    ]
    recorded, measured, told = table.rows
    assert recorded["peer, ms"] == "100"
    assert str(measured["peer, ms"]).endswith(", here")
    assert isinstance(recorded["deux here, ms"], Spread)
    assert float(str(recorded["times the peer's speed"])) == pytest.approx(10.0, rel=0.5)
    assert float(str(measured["times the peer's speed"])) == pytest.approx(4.0, rel=0.6)
    assert told["times the peer's speed"] == "2.00"


def test_what_is_compared_is_the_same_work() -> None:
    path, everywhere = peer_figures._planning()
    by_library = path.peers[0].call
    assert by_library is not None
    found, theirs = path.call(), np.array(by_library())
    assert found[[0, -1]].tolist() == theirs[[0, -1]].tolist() == [[0, 0], [399, 399]]
    # The library cuts corners, which a robot with a body cannot.
    assert path_length(theirs) <= path_length(found) < 1.1 * path_length(theirs)
    assert everywhere.call()[399, 399] == pytest.approx(path_length(found))
