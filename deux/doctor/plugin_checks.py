"""Checks of the installed plugins, and of those that the configuration chooses."""

import warnings
from collections.abc import Iterator

from omegaconf import DictConfig

import deux
from deux.doctor.checkup import Checkup
from deux.errors import DeuxError
from deux.plain_settings import plain
from deux.plugin_kinds import KINDS, Plugin
from deux.registry import registry
from deux.task_sections import PLUGIN_SECTIONS, TASKS


def check_plugins(checkup: Checkup) -> None:
    """Load every installed plugin and report it by kind and package, or its error.

    A broken plugin affects only those who choose it, so it is not a fault.
    """
    checkup.heading("Plugins")
    broken = {}
    for kind in KINDS:
        working: dict[str, list[str]] = {}
        for plugin in registry().plugins(kind):
            if problem := _problem(plugin):
                broken[f"{kind} {plugin.name}"] = problem
            else:
                working.setdefault(f"{plugin.package} {plugin.version}", []).append(plugin.name)
        listed = [f"{', '.join(names)} ({package})" for package, names in working.items()]
        checkup.fact(kind, "; ".join(listed) or "none")
    for name, problem in broken.items():
        checkup.fact("broken", f"{name}: {problem}")


def check_chosen_plugins(checkup: Checkup, cfg: DictConfig) -> None:
    """Report the plugins that the configuration's task uses; a missing plugin or requirement is a fault."""
    checkup.heading(f"Asked for: task={cfg.task}")
    for section, kind, settings in _chosen(cfg):
        try:
            choice = registry().choose(kind, settings, section)
            cls = registry().get(kind, choice.name)
        except DeuxError as error:
            checkup.fault(str(error))
            continue
        if problem := lacking(cls):
            checkup.fault(f"{section}={choice.name}: {problem}")
        else:
            checkup.fact(section, choice.name)


def lacking(cls: type) -> str:
    """What a plugin requires and this machine lacks, in one sentence, or "".

    It is the result of the plugin's static method `lacking() -> str`, which is optional and only needed for
    requirements other than the dependencies of its package.
    """
    method = getattr(cls, "lacking", None)
    return str(method()) if callable(method) else ""


def check_models(checkup: Checkup) -> None:
    """Report the shipped models."""
    checkup.heading("Shipped models")
    checkup.fact("deux.load", ", ".join(deux.available()) or "none")


def _chosen(cfg: DictConfig) -> Iterator[tuple[str, str, dict]]:
    """Section, kind and options of each plugin that the task uses; simulator and scenes are checked separately."""
    sections = TASKS[cfg.task].sections
    for section, kind in PLUGIN_SECTIONS.items():
        if section in sections and section not in ("simulator", "scenes"):
            yield section, kind, plain(cfg[section], section)
    if "objective" in sections:
        for name, term in plain(cfg.objective, "objective").items():
            options = {key: value for key, value in term.items() if key != "weight"} if isinstance(term, dict) else {}
            yield f"objective.{name}", "losses", {"name": name, **options}
    if "collect" in sections:
        options = plain(cfg.collect.uncertainty_options, "collect.uncertainty_options")
        yield "collect.uncertainty", "uncertainties", {"name": cfg.collect.uncertainty, **options}


def _problem(plugin: Plugin) -> str:
    """Why a plugin cannot be loaded; "" if it can."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings of third-party modules are irrelevant here
            registry().get(plugin.kind, plugin.name)
    except DeuxError as error:
        return str(error)
    except SystemExit as error:  # a third-party module may raise it
        return f"{plugin.origin} ends the process when it is imported (SystemExit: {error})."
    return ""
