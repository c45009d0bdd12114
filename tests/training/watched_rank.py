"""One of two processes that watch each other, for `test_rank_failures.py`.

    python watched_rank.py RANK PORT WAY

It leads if RANK is 0. WAY says how it ends: "waits" for ever, as in a collective operation; "fails" with a mistake of
the user's; "loses": an operation between the processes fails; "dies" at once, without a word.
"""

import os
import sys
import time
from datetime import timedelta

import torch

from deux.errors import DeuxError
from deux.training.rank_failures import RankWatch


def main(rank: int, port: int, way: str) -> int:
    store = torch.distributed.TCPStore(
        "127.0.0.1", port, is_master=rank == 0, timeout=timedelta(seconds=60), wait_for_workers=False
    )
    watch = RankWatch(store, rank, 2, interval=0.1, silence=2.0)
    watch.start()
    while not store.check([f"alive-{1 - rank}"]):
        time.sleep(0.05)
    time.sleep(0.5)
    if way == "dies":
        os._exit(9)
    if way == "waits":
        time.sleep(120)
    error = DeuxError("a frame is broken.") if way == "fails" else RuntimeError("[gloo] Connection closed by peer")
    print(f"deux: {watch.fail(error, str(error)) or error}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]))
