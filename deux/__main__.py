"""The command line: `python -m deux [option=value ...]`, or `deux` where the package is installed."""

from __future__ import annotations

import argparse
import gc
import importlib
import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from deux.composition_errors import check_names, composition_error, quoted_digits, raised_in_composition
from deux.configuration import CONFIG_NAME, check_unused, config_folder, in_sweep, register_configuration
from deux.errors import DeuxError, JobFailed, counted, printable
from deux.interruption import Terminated, termination_raised
from deux.machine_failures import PLACE_ERRORS, ended_by_sigterm, machine_failure
from deux.plugin_failures import raised_in
from deux.search_path import leave_out_working_folder
from deux.task_sections import check_plugin_options, check_plugins
from deux.thread_waiting import let_waiting_threads_sleep

LAUNCHERS = ("joblib", "submitit", "ray")
"""The packages behind `hydra/launcher=...`. They raise errors of their own for jobs that end without a word, such as
those that the system killed for their memory."""

log = logging.getLogger("deux")


class Jobs:
    """What Hydra calls once for a run and once for each job of a sweep.

    A launcher such as `joblib` sends a copy to other processes, whose jobs are not counted here.

    Attributes:
        started: number of jobs begun in this process.
        failed: number of a sweep's jobs that failed in this process.
    """

    def __init__(self) -> None:
        self.started = 0
        self.failed = 0

    def run(self, cfg: DictConfig) -> None:
        """Run one job. Its error is reported at once; it ends a single run, and a sweep goes on to its next job."""
        self.started += 1
        try:
            check_unused(cfg, HydraConfig.get().overrides.task)
            run_task(cfg)
        except KeyboardInterrupt as interrupt:
            _stay_until_killed(interrupt)
            raise
        except Exception as error:
            if ended_by_sigterm(error):
                raise Terminated from error
            # At level INFO the log file gets the stack trace and the console does not.
            log.info("the run ended with an error", exc_info=True)
            sentence = _report(error)
            _release_frames(error)
            if not in_sweep():
                raise SystemExit(1) from error
            self.failed += 1
            raise JobFailed(sentence) from error


def main() -> int:
    """Run the command line and return its exit code, or leave with it by `SystemExit`.

    0: done; 1: a mistake of the user's, told in one sentence on stderr, or an error of the program, with its stack
    trace, or a sweep in which some job failed; 130: interrupted by Ctrl-C; 143: ended by SIGTERM.
    """
    if problem := _unusable_surroundings():
        return _complain(problem)
    leave_out_working_folder()
    let_waiting_threads_sleep()
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises errors instead of printing them in a way of its own.
    jobs = Jobs()
    try:
        register_configuration()
        sys.argv[1:] = sorted((quoted_digits(argument) for argument in sys.argv[1:]), key=_goes_behind)
        check_names(argument for argument in sys.argv[1:] if "=" in argument and not argument.startswith("-"))
        with _quiet_log_writers(), termination_raised(), _help_unchecked():
            hydra.main(version_base="1.3", config_path=str(config_folder()), config_name=CONFIG_NAME)(jobs.run)()
    except KeyboardInterrupt as interrupt:
        if _was_terminated(interrupt):
            return _complain("ended by SIGTERM; the same command goes on from here.", 143)
        return _complain("interrupted; the same command goes on from here.", 130)
    except BrokenPipeError:  # the reader of the help page or configuration, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains once more as it ends
        return 0
    except JobFailed as error:
        if jobs.failed:
            return _complain(f"{jobs.failed} of the sweep's {counted(jobs.started, 'job')} failed, as reported above.")
        _complain(str(error))
        return _complain("a job of the sweep failed, perhaps not this one alone: deux.log in each run's folder tells.")
    except Exception as error:
        if sentence := sentence_of(error):
            return _complain(sentence)
        if type(error).__module__.partition(".")[0] in LAUNCHERS:
            told = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
            return _complain(f"the sweep's launcher stopped with {told} The same command goes on from here.")
        raise
    return 0


def _goes_behind(argument: str) -> bool:
    """Whether an argument is none of the flags that Hydra's parser knows before the first option only."""
    return argument not in ("-m", "--multirun")


def sentence_of(error: Exception) -> str | None:
    """The sentence for an error that is the user's mistake, or a place's that takes no files; None for the program's.

    Args:
        error: of the composition of a configuration, or of a job.
    """
    if mistake := _mistake(error):
        return str(mistake)
    return str(composition_error(error)) if raised_in_composition(error) else None


def run_task(cfg: DictConfig) -> None:
    """Import the task that the configuration names, and run it.

    Importing a task takes longer than importing the plugins that have options: their mistakes are told first.

    Raises:
        DeuxError: an unknown task, a plugin that is not installed or that does not have an option, or what the task
            itself finds wrong.
    """
    check_plugins(cfg)
    check_plugin_options(cfg)
    importlib.import_module(f"deux.tasks.{cfg.task}").run(cfg)


def _stay_until_killed(interrupt: KeyboardInterrupt) -> None:
    """Let a sweep's job whose training Slurm has ended by SIGTERM wait for the SIGKILL that follows.

    A job that is preempted with a time of grace is queued again only if it is still there when that time is over.
    """
    if not (_was_terminated(interrupt) and in_sweep() and "SLURM_JOB_ID" in os.environ):
        return
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    log.warning("Slurm ends this job; if it is queued again, it goes on from here.")
    while True:
        signal.pause()


def _was_terminated(interrupt: BaseException | None) -> bool:
    """Whether SIGTERM is behind an interrupt: deux's own answer to it, or Lightning's, which it wraps in others."""
    while interrupt is not None:
        if isinstance(interrupt, Terminated) or type(interrupt).__name__ == "SIGTERMException":
            return True
        interrupt = interrupt.__cause__ or interrupt.__context__
    return False


@contextmanager
def _help_unchecked() -> Iterator[None]:
    """Let Hydra make its parser of the command line from Python 3.14 on, whose argparse checks help texts at once.

    One of Hydra 1.3's is an object that becomes a text when it is shown (facebookresearch/hydra, issue 3121).
    """
    module: Any = sys.modules["hydra.main"]
    parser: Any = argparse.ArgumentParser
    make = module.get_args_parser

    def make_unchecked() -> argparse.ArgumentParser:
        parser._check_help = lambda *_: None  # in front of what it inherits
        try:
            return make()
        finally:
            del parser._check_help

    module.get_args_parser = make_unchecked
    try:
        yield
    finally:
        module.get_args_parser = make


def _unusable_surroundings() -> str | None:
    """The sentence for a working folder or a locale in which no configuration can be composed; None for others."""
    if sys.getfilesystemencoding().lower() != "utf-8":
        found = sys.getfilesystemencoding()
        return f"this Python takes file names and texts for {found}: start it with PYTHONUTF8=1, or in a UTF-8 locale."
    try:
        here = os.getcwd()
    except OSError as error:
        return f"the working folder cannot be used, {error.strerror}: start the command in another one."
    if "${" in here:
        return f"the name of the folder {here} reads as a reference to an option: start the command in another one."
    return None


@contextmanager
def _quiet_log_writers() -> Iterator[None]:
    """Let no log file on a full disk bury the one sentence under the stack traces of its writer.

    That is Python's logging, and TensorBoard's thread, whose error comes back with its next record.
    """
    raise_exceptions, excepthook = logging.raiseExceptions, threading.excepthook

    def report(failed: threading.ExceptHookArgs) -> None:
        if not (isinstance(failed.exc_value, OSError) and failed.exc_value.errno in PLACE_ERRORS):
            excepthook(failed)

    logging.raiseExceptions, threading.excepthook = False, report
    try:
        yield
    finally:
        logging.raiseExceptions, threading.excepthook = raise_exceptions, excepthook


def _report(error: Exception) -> str:
    """Tell a job's error on stderr; return the sentence."""
    error = _first_failure(error)
    overrides = f"[{' '.join(HydraConfig.get().overrides.task)}] " if in_sweep() else ""
    if mistake := _mistake(error):
        sentence = f"{overrides}{mistake}"
    else:
        traceback.print_exception(error)
        place = raised_in(error)
        fault = f"a fault of the package {place}" if place else "a fault of the program or of a plugin"
        sentence = f"{overrides}stopped by {type(error).__name__}, which is {fault}."
    _complain(sentence)
    return sentence


def _release_frames(error: BaseException) -> None:
    """Free what an error's frames hold, and let no complaint of half-made objects follow the sentence.

    A loader of torch's whose processes could not be started is one: it fails again when it is deleted.
    """
    earlier, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        behind: BaseException | None = error
        while behind is not None:
            traceback.clear_frames(behind.__traceback__)
            behind = behind.__cause__ or behind.__context__
        gc.collect()
    finally:
        sys.unraisablehook = earlier


def _first_failure(error: Exception) -> Exception:
    """What ends this process: another one's failure, where several train together and it came first."""
    failures = sys.modules.get("deux.training.rank_failures")  # only a training imports it, and it brings torch
    if failures is None:
        return error
    sentence = str(_mistake(error) or f"an error of the program, {type(error).__name__}: {error}")
    return failures.told_to_all(error, sentence) or error


def _mistake(error: Exception) -> DeuxError | None:
    """The sentence for an error that is none of the program's: the user's mistake, or a limit of the machine's."""
    if isinstance(error, DeuxError):
        return error
    folder = None
    if HydraConfig.initialized() and not OmegaConf.is_missing(runtime := HydraConfig.get().runtime, "output_dir"):
        folder = Path(runtime.output_dir)
    found = machine_failure(error, folder)
    return None if found is None else DeuxError(found)


def _complain(sentence: str, code: int = 1) -> int:
    print(f"deux: {printable(sentence)}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
