"""The benchmarks from the command line: `python -m deux.bench [BENCHMARK] [--quick] [--json PATH]`."""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deux.errors import DeuxError
from deux.thread_waiting import let_waiting_threads_sleep

if TYPE_CHECKING:
    from deux.bench.speed_tables import SpeedTable

BENCHMARKS = (
    "render",
    "batching",
    "explore",
    "processes",
    "environment",
    "models",
    "published",
    "limits",
    "data",
    "peers",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmarks and return the exit code: 0, or 1 after a mistake of the user's, told on stderr."""
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
    parser.add_argument("--quick", action="store_true", help="small and short: two minutes for all")
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
    # PyTorch's profiler tells of its beginning and end on stderr.
    os.environ.setdefault("KINETO_LOG_LEVEL", "99")
    # Imported here because they bring torch, which `--help` must not wait for.
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
    if name == "render":
        from deux.bench import render_speed as render

        return render.measure_rendering(render.QUICK if options.quick else render.RenderSettings(), options.scene)
    if name == "batching":
        from deux.bench import batching_speed as batching

        return batching.measure_batching(
            batching.QUICK if options.quick else batching.BatchingSettings(), options.model, options.device
        )
    if name == "explore":
        from deux.bench import exploration_speed as exploration

        return exploration.measure_exploration(
            exploration.QUICK if options.quick else exploration.ExploreSettings(), options.model, options.device
        )
    if name == "environment":
        from deux.bench import environment_speed as environment

        return environment.measure_environment(
            environment.QUICK if options.quick else environment.EnvironmentSettings()
        )
    if name == "published":
        from deux.bench import published_way as published

        return published.measure_published_way(
            published.QUICK if options.quick else published.PublishedSettings(), options.device
        )
    if name == "data":
        from deux.bench import data_waiting as data

        return data.measure_data_waiting(
            data.QUICK if options.quick else data.WaitingSettings(), options.model, options.device
        )
    if name == "limits":
        from deux.bench import step_limits as limits

        return limits.measure_limits(limits.QUICK if options.quick else limits.LimitSettings(), options.device)
    if name == "peers":
        from deux.bench import peer_figures as peers

        return peers.measure_peers(
            peers.QUICK if options.quick else peers.PeerSettings(), options.scene, options.device
        )
    if name == "processes":
        from deux.bench import process_speed as processes

        return processes.measure_processes(
            processes.QUICK if options.quick else processes.ProcessSettings(), options.model, options.device
        )
    from deux.bench import model_speed as models

    return models.measure_models(models.QUICK if options.quick else models.ModelSettings(), options.device)


if __name__ == "__main__":
    sys.exit(main())
