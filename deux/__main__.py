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
from deux.interruption import Terminated, interrupt_behind, termination_raised
from deux.machine_failures import PLACE_ERRORS, ended_by_sigterm, machine_failure
from deux.plugin_failures import raised_in
from deux.search_path import leave_out_working_folder
from deux.task_sections import check_plugin_options, check_plugins
from deux.thread_waiting import let_waiting_threads_sleep

LAUNCHERS = ("joblib", "submitit", "ray")
"""The packages of `hydra/launcher=...`. They raise their own errors for jobs that die without a message, such as when
the system kills them for lack of memory."""

log = logging.getLogger("deux")


class Jobs:
    """Runs jobs for Hydra, which calls `run` once for a run and once for each job of a sweep.

    A launcher such as `joblib` sends copies to other processes; their jobs are not counted here.

    Attributes:
        started: number of jobs started in this process.
        failed: number of a sweep's jobs that failed in this process.
    """

    def __init__(self) -> None:
        self.started = 0
        self.failed = 0

    def run(self, cfg: DictConfig) -> None:
        """Run one job and report its error; an error ends a single run, but a sweep continues with its next job."""
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
            behind = interrupt_behind(error)
            if behind and not _mistake(error):  # a lost lock interrupts its process, and has a sentence of its own
                _stay_until_killed(behind)
                raise KeyboardInterrupt from error
            # At level INFO, the stack trace goes to the log file but not to the console.
            log.info("the run ended with an error", exc_info=True)
            sentence = _report(error)
            _release_frames(error)
            if not in_sweep():
                raise SystemExit(1) from error
            self.failed += 1
            raise JobFailed(sentence) from error


def main() -> int:
    """Run the command line and return its exit code, or exit with it by `SystemExit`.

    0: success. 1: a user's mistake, reported in one sentence on stderr; an error of the program, reported with its
    stack trace; or a sweep with failed jobs. 130: interrupted by Ctrl-C. 143: ended by SIGTERM.
    """
    if problem := _unusable_surroundings():
        return _complain(problem)
    leave_out_working_folder()
    let_waiting_threads_sleep()
    os.environ["HYDRA_FULL_ERROR"] = "1"  # makes Hydra raise errors instead of printing them in its own format
    jobs = Jobs()
    try:
        register_configuration()
        sys.argv[1:] = sorted((quoted_digits(argument) for argument in sys.argv[1:]), key=_follows_flags)
        check_names(argument for argument in sys.argv[1:] if "=" in argument and not argument.startswith("-"))
        with _quiet_log_writers(), termination_raised(), _help_unchecked():
            hydra.main(version_base="1.3", config_path=str(config_folder()), config_name=CONFIG_NAME)(jobs.run)()
    except KeyboardInterrupt as interrupt:
        if _was_terminated(interrupt):
            return _complain("ended by SIGTERM; the same command goes on from here.", 143)
        return _complain("interrupted; the same command goes on from here.", 130)
    except BrokenPipeError:  # such as from `deux --help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python reports it again at exit
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


def _follows_flags(argument: str) -> bool:
    """Sort key: false for the flags that Hydra's parser accepts only before the first override."""
    return argument not in ("-m", "--multirun")


def sentence_of(error: Exception) -> str | None:
    """The message for an error that is the user's mistake or the machine's limit; None for an error of the program.

    Args:
        error: raised while composing a configuration, or by a job.
    """
    if mistake := _mistake(error):
        return str(mistake)
    return str(composition_error(error)) if raised_in_composition(error) else None


def run_task(cfg: DictConfig) -> None:
    """Import the configuration's task and run it.

    Plugins and their options are checked first, since importing a task is slow.

    Raises:
        DeuxError: the task is unknown, a plugin is not installed or does not have an option, or the task raises it.
    """
    check_plugins(cfg)
    check_plugin_options(cfg)
    importlib.import_module(f"deux.tasks.{cfg.task}").run(cfg)


def _stay_until_killed(interrupt: KeyboardInterrupt) -> None:
    """In a sweep's job that Slurm ends by SIGTERM, wait for the SIGKILL that follows.

    Slurm requeues a job that is preempted with a grace period only if it is still running when that period ends.
    """
    if not (_was_terminated(interrupt) and in_sweep() and "SLURM_JOB_ID" in os.environ):
        return
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    log.warning("Slurm ends this job; if it is queued again, it goes on from here.")
    while True:
        signal.pause()


def _was_terminated(interrupt: BaseException | None) -> bool:
    """Whether SIGTERM caused an interrupt, as raised by deux or by Lightning, which wraps it in other exceptions."""
    while interrupt is not None:
        if isinstance(interrupt, Terminated) or type(interrupt).__name__ == "SIGTERMException":
            return True
        interrupt = interrupt.__cause__ or interrupt.__context__
    return False


@contextmanager
def _help_unchecked() -> Iterator[None]:
    """Disable argparse's check of help texts while Hydra 1.3 creates its parser, which fails it on Python 3.14.

    One of Hydra's help texts is an object that becomes text only when shown (facebookresearch/hydra, issue 3121).
    """
    module: Any = sys.modules["hydra.main"]
    parser: Any = argparse.ArgumentParser
    make = module.get_args_parser

    def make_unchecked() -> argparse.ArgumentParser:
        parser._check_help = lambda *_: None  # hides the inherited method
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
    """The message about a working folder or locale in which no configuration can be composed, or None."""
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
    """Suppress the stack traces of log writers on a full disk, which would hide the one error message.

    The writers are Python's logging and TensorBoard's thread, whose error is raised again by its next record.
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
    """Report a job's error on stderr and return the message."""
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
    """Free the local variables of an error's stack frames, suppressing errors of their finalizers.

    For example, a torch data loader whose processes could not be started fails again when it is deleted.
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
    """The error to report: if several processes train together, that of the process which failed first."""
    failures = sys.modules.get("deux.training.rank_failures")  # imported only by trainings; it imports torch
    if failures is None:
        return error
    sentence = str(_mistake(error) or f"an error of the program, {type(error).__name__}: {error}")
    return failures.share_failure(error, sentence) or error


def _mistake(error: Exception) -> DeuxError | None:
    """The error as a DeuxError if it is the user's mistake or a limit of the machine; None for the program's errors."""
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
