"""Which plugins are installed, whether each of them can be loaded, and whether those that are asked for fit."""

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
    """Load every installed plugin and report it by kind and package; one that cannot be loaded is told with its error.

    A plugin that is broken harms nobody who does not choose it, so it is a fact and no fault.
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
    """Report the plugins that the configuration's task uses; each must be there and have all that it needs."""
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
    """What a plugin lacks on this machine, in one sentence, "" for nothing.

    The plugin says so itself by a static method `lacking() -> str`, which is optional: one that needs no more than its
    package's dependencies has none.
    """
    told = getattr(cls, "lacking", None)
    return str(told()) if callable(told) else ""


def check_models(checkup: Checkup) -> None:
    """Report the trained models that the installation holds, if any."""
    available = getattr(deux, "available", None)
    if available is not None:
        checkup.heading("Shipped models")
        checkup.fact("deux.load", ", ".join(available()) or "none")


def _chosen(cfg: DictConfig) -> Iterator[tuple[str, str, dict]]:
    """Section, kind and settings of each plugin that the task reads; simulator and scenes have checks of their own."""
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
    """Why a plugin cannot be loaded; "" where it can."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what a foreign module warns of when it is imported says nothing here
            registry().get(plugin.kind, plugin.name)
    except DeuxError as error:
        return str(error)
    except SystemExit as error:  # a foreign module may do that, too
        return f"{plugin.origin} ends the process when it is imported (SystemExit: {error})."
    return ""
