"""The connection to a Ray cluster (https://docs.ray.io)."""

import logging
import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from deux.errors import DeuxError

try:
    import ray
except ImportError as error:
    raise DeuxError(f"collect.executor=ray cannot import Ray ({error}): pip install 'deux[ray]'.") from error

log = logging.getLogger(__name__)

_ATTEMPTS = 3
"""Attempts to start Ray on this machine; on a busy machine, starting may take longer than Ray's own timeout."""


@contextmanager
def connected(address: str | None) -> Iterator[None]:
    """Connect to a Ray cluster without console output, unless this process is already connected.

    Raises:
        DeuxError: there is no cluster at the address.
    """
    if ray.is_initialized():
        yield
        return
    # When a machine is lost, Ray prints the end of its log to the console.
    with patch("ray._private.worker.print_to_stdstream", _to_log):
        _connect(address)
        try:
            yield
        finally:
            ray.shutdown()


def _connect(address: str | None) -> None:
    if address not in (None, "auto"):
        _check_answers(address)
    terminate = signal.getsignal(signal.SIGTERM)
    if address is None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    settings: dict[str, Any] = {} if address else {"include_dashboard": False}
    for attempt in range(_ATTEMPTS):
        try:
            ray.init(address or "local", log_to_driver=False, logging_level=logging.ERROR, **settings)
            break
        except Exception as error:  # Ray raises a bare Exception if its processes do not start within 30 s
            ray.shutdown()
            reason = str(error).splitlines()[0].split(". ")[0].rstrip(".")
            if address is None and attempt < _ATTEMPTS - 1:
                log.warning("Ray does not start, which is tried again: %s", reason)
                continue
            if address is None:
                raise DeuxError(f"Ray does not start: {reason}; collect.processes=N does without it here.") from error
            raise DeuxError(
                f"collect.executor_options.address={address} cannot be reached: {reason}; a cluster is started by "
                "`ray start --head`."
            ) from error
    if terminate is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, terminate)  # Ray's handler would remain after disconnecting


def _check_answers(address: str) -> None:
    """Raise DeuxError unless something listens at host:port: Ray itself tries for minutes."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=10.0).close()
    except (OSError, ValueError) as error:
        raise DeuxError(
            f"collect.executor_options.address is {address!r}, but no Ray cluster answers there ({error}): it must be "
            "the host:port that `ray start --head` printed."
        ) from error


def room(cpus: int, gpus: float) -> int:
    """The number of workers that fit on the machines of the cluster, ignoring what else runs there.

    Args:
        cpus: cores of each worker.
        gpus: share of a GPU of each worker.
    """
    return sum(
        min(
            int(node["Resources"].get("CPU", 0.0) // cpus),
            int(node["Resources"].get("GPU", 0.0) / gpus + 1e-6) if gpus else 2**31,
        )
        for node in ray.nodes()
        if node["Alive"]
    )


def _to_log(data: dict[str, Any], ignore_prefix: bool) -> None:
    """Replacement of Ray's function that prints its processes' output."""
    log.debug("Ray: %s", "\n".join(data["lines"]))
