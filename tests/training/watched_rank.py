"""One of two processes that watch each other, for `test_rank_failures.py`.

    python watched_rank.py RANK PORT WAY

It leads if RANK is 0. WAY says how it ends: "waits" for ever, as in a collective operation; "dies" at once, without a
word.
"""

import os
import sys
import time
from datetime import timedelta

import torch

from deux.training.rank_watch import RankWatch


def watched(rank: int, port: int) -> RankWatch:
    """The watch of one of the two, once both have shown life."""
    store = torch.distributed.TCPStore(
        "127.0.0.1", port, is_master=rank == 0, timeout=timedelta(seconds=60), wait_for_workers=False
    )
    watch = RankWatch(store, rank, 2, interval=0.1, silence=2.0)
    watch.start()
    while not store.check([f"alive-{1 - rank}"]):
        time.sleep(0.05)
    time.sleep(0.5)
    return watch


if __name__ == "__main__":
    watched(int(sys.argv[1]), int(sys.argv[2]))
    if sys.argv[3] == "dies":
        os._exit(9)
    time.sleep(120)
