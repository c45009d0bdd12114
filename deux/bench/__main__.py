"""Command-line interface of the benchmarks: `python -m deux.bench [BENCHMARK] [--quick] [--json PATH]`."""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from deux.errors import DeuxError
from deux.thread_waiting import let_waiting_threads_sleep

if TYPE_CHECKING:
    from deux.bench.speed_tables import SpeedTable


class Benchmark(NamedTuple):
    """Location of a benchmark's code. Its module is only imported when the benchmark runs.

    Args:
        module: name of the module in `deux.bench`. The module defines `QUICK`, an instance of its settings class.
        measure: name of the generator function that yields the tables. It is called with the settings and the values
            of `options`.
        options: names of the command-line options that are passed to `measure`.
    """

    module: str
    measure: str
    options: tuple[str, ...] = ()


BENCHMARKS = {
    "render": Benchmark("render_speed", "measure_rendering", ("scene",)),
    "scenes": Benchmark("scene_speed", "measure_scenes"),
    "batching": Benchmark("batching_speed", "measure_batching", ("model", "device")),
    "explore": Benchmark("exploration_speed", "measure_exploration_speed", ("model", "device")),
    "processes": Benchmark("process_speed", "measure_processes", ("model", "device")),
    "environment": Benchmark("environment_speed", "measure_environment"),
    "models": Benchmark("model_speed", "measure_models", ("device",)),
    "published": Benchmark("published_training", "measure_published_training", ("device",)),
    "limits": Benchmark("step_limits", "measure_limits", ("device",)),
    "data": Benchmark("data_waiting", "measure_data_waiting", ("model", "device")),
    "peers": Benchmark("peer_figures", "measure_peers", ("scene", "device")),
}
"""Benchmarks by name, in the order in which `all` runs them."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmarks and return the exit code: 0, or 1 for a user's mistake, reported on stderr."""
    options = _parser().parse_args(arguments)
    let_waiting_threads_sleep()
    try:
        _run(options)
    except DeuxError as error:
        print(f"deux: {error}", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m deux.bench",
        description="Measure how fast deux renders, explores and trains here. What is compared takes turns within one "
        "run, so ratios hold on a busy machine too; each number is a median with its 10th and 90th percentile.",
    )
    parser.add_argument("benchmark", nargs="?", default="all", choices=[*BENCHMARKS, "all"], help="default: all")
    parser.add_argument("--quick", action="store_true", help="small and short")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write the numbers to this file, too")
    parser.add_argument(
        "--scene",
        type=Path,
        metavar="PATH",
        help="scene file to render in place of the flat with its faces split; for peers, of the flat",
    )
    parser.add_argument(
        "--model",
        metavar="NAME",
        help="depth model that guides explorers, untrained; default: the first that is installed and unsupervised",
    )
    parser.add_argument(
        "--device",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="where models compute; default: a CUDA device where there is one",
    )
    parser.add_argument(
        "--threads", type=_positive, metavar="N", help="threads of torch and OpenCV; default: all cores"
    )
    return parser


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of 1 or more")
    return int(text)


def _run(options: argparse.Namespace) -> None:
    # Otherwise, PyTorch's profiler logs its start and end to stderr.
    os.environ.setdefault("KINETO_LOG_LEVEL", "99")
    # Imported here because they import torch, which would slow down `--help`.
    from deux.bench.machine import prepare_machine
    from deux.bench.speed_tables import make_console, print_table
    from deux.io.atomic import write_json

    console = make_console()
    machine = prepare_machine(options.threads, options.device)
    console.print(str(machine), markup=False, end="\n\n")
    tables = []
    for name in BENCHMARKS if options.benchmark == "all" else [options.benchmark]:
        with console.status(f"{name} ..."):
            for table in _tables(name, options):
                print_table(console, table)
                tables.append(table)
    if options.json is not None:
        write_json(options.json, {"machine": machine.as_json(), "tables": [table.as_json() for table in tables]})


def _tables(name: str, options: argparse.Namespace) -> "Iterator[SpeedTable]":
    chosen = BENCHMARKS[name]
    module = import_module(f"deux.bench.{chosen.module}")
    settings = module.QUICK if options.quick else type(module.QUICK)()
    tables: Iterator[SpeedTable] = getattr(module, chosen.measure)(
        settings, *(getattr(options, option) for option in chosen.options)
    )
    return tables


if __name__ == "__main__":
    sys.exit(main())
