"""How many threads compute, and predictions whose bits do not depend on it.

Convolutions and sums are split among PyTorch's threads, so the last bits of what a depth model predicts on a CPU depend
on their number, in float32 and bfloat16 alike. What has to be the same in every process and on every machine is
computed on one thread, and several frames at the same time instead.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import torch
from torch import Tensor


def limit_threads(count: int) -> None:
    """Let PyTorch, OpenCV and OpenGL without a card take at most `count` threads each in this process."""
    import cv2  # here, because a model that only predicts needs no OpenCV

    torch.set_num_threads(min(count, torch.get_num_threads()))
    cv2.setNumThreads(min(count, cv2.getNumThreads()))
    os.environ.setdefault("LP_NUM_THREADS", str(count))  # Mesa reads it when it is first used


@contextmanager
def one_thread() -> Iterator[None]:
    """Let the calling thread compute with PyTorch by itself for a while."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def each_frame_apart(predict: Callable[..., Tensor], frames: tuple[Tensor, ...], threads: int) -> Tensor:
    """Predict the frames of a batch one by one, each on one thread, several at the same time.

    A frame's prediction then depends on nothing else, to the last bit. Threads that work on a frame each do not wait
    for one another within every operation, which takes most of the time where other programs want the same cores.

    Args:
        predict: called with batches of one frame, from several threads at the same time.
        frames: its arguments, each with the batch as first dimension.
        threads: number of frames that are predicted at the same time.

    Returns:
        What `predict` returns, with the batch as first dimension.
    """
    single = list(zip(*(tensor.split(1) for tensor in frames), strict=True))
    with one_thread():
        if min(threads, len(single)) == 1:
            return torch.cat([predict(*frame) for frame in single])
        # The number of threads is each thread's own: new ones are told as well.
        with ThreadPoolExecutor(min(threads, len(single)), initializer=torch.set_num_threads, initargs=(1,)) as pool:
            return torch.cat(list(pool.map(lambda frame: predict(*frame), single)))
