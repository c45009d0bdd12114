"""Writes the reference of all options, docs/reference/configuration.md: python docs/reference.py

Options, types and descriptions are those of the constructors, defaults those of `python -m deux`. The
page is made before the site is built and is not committed.
"""

import inspect
import sys
from collections.abc import Collection, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import griffe
from omegaconf import DictConfig

from deux.configuration import compose
from deux.options import REQUIRED, describe, options
from deux.plain_settings import plain
from deux.plugin_kinds import KINDS, Kind
from deux.registry import registry
from deux.task_sections import TASKS

PAGE = Path(__file__).parent / "reference" / "configuration.md"

PACKAGE = "deux"
"""Plugins of this distribution are described; others that happen to be installed are not part of the site."""

SECTIONS = {
    "camera": "deux.geometry.camera:Camera",
    "robot": "deux.geometry.robot:Robot",
    "collect": "deux.collection.collect_settings:CollectSettings",
    "sampling": "deux.collection.sparse:SparseSettings",
    "verification": "deux.collection.verification:VerificationSettings",
    "seed_model": "deux.tasks.seed_model:SeedModelSettings",
    "foundation": "deux.tasks.model_training:FoundationSettings",
    "training": "deux.training.training_settings:TrainingSettings",
    "callbacks.active_collection": "deux.tasks.active_training:ActiveCollectionSettings",
    "evaluation": "deux.tasks.evaluate:EvaluationSettings",
    "explorer_training": "deux.tasks.train_explorer:ExplorerTrainingSettings",
    "compare": "deux.tasks.compare_explorers:CompareSettings",
    "predict": "deux.tasks.predict:PredictSettings",
    "export": "deux.tasks.export:ExportSettings",
    "export_dataset": "deux.tasks.export_dataset:ExportDatasetSettings",
    "report": "deux.tasks.report:ReportSettings",
    "collect.executor_options": "deux.collection.ray_execution:RayExecutor",
}
"""The sections of the configuration that are not a plugin's, and the class whose constructor reads each."""

INTRODUCTION = """# Configuration

Any line can be given on the command line, `python -m deux camera.width=256`, or in a YAML file of your own package
([Writing a plugin](../plugins.md#configuration-files-in-a-package)). An option that does not exist or a value of the
wrong type ends the command with one sentence, before any work is done. `python -m deux --help` lists groups and
presets, and `python -m deux --cfg job` with options prints the composed configuration.

The lists are made from the constructors; a required option has no default.
"""


def write_reference(path: Path = PAGE) -> Path:
    """Write the page and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(_page()).rstrip() + "\n")
    return path


def _page() -> Iterator[str]:
    cfg = compose(["callbacks=[active_collection]"])
    yield INTRODUCTION
    yield "## Tasks\n"
    for name, task in TASKS.items():
        sections = ", ".join(f"`{section}`" for section in task.sections)
        yield f"- `task={name}`: {_line(task.purpose)}. It reads {sections}."
    yield "\n## Sections\n"
    for section, target in SECTIONS.items():
        module, _, attribute = target.partition(":")
        cls = getattr(import_module(module), attribute)
        yield f"### `{section}`\n"
        yield from _described(cls, section, (), _node(cfg, section))
    for kind in KINDS.values():
        yield from _plugins(kind)
    yield "## The file with all defaults\n"
    yield "`conf/config.yaml`; `conf/` also holds the presets of each group.\n"
    yield f"```yaml\n{(Path(__file__).parents[1] / 'conf' / 'config.yaml').read_text()}```"


def _plugins(kind: Kind) -> Iterator[str]:
    yield f"## {kind.name.replace('_', ' ').capitalize()}\n"
    for plugin in registry().plugins(kind.name):
        if plugin.package == PACKAGE:
            yield f"### {kind.noun} `{plugin.name}`\n"
            where = kind.settings.format(name=plugin.name)
            yield from _described(registry().get(kind.name, plugin.name), where, kind.given, {})


def _described(cls: type, where: str, given: Collection[str], chosen: dict[str, Any]) -> Iterator[str]:
    """What a class says of itself, and its options; `chosen` are values of the default configuration."""
    yield _text(cls) + "\n"
    known = options(cls, given)
    if not known:
        yield "No options.\n"
        return
    meanings = _meanings(cls)
    for name, option in known.items():
        default = chosen.get(name, option.default)
        shown = "required" if default is REQUIRED else f"default `{_yaml(default)}`"
        meaning = _line(meanings.get(name, ""))
        yield f"- `{where}.{name}` ({_line(describe(option.annotation))}; {shown}): {meaning}"
    yield ""


def _text(cls: type) -> str:
    """The description of a class without its sections for arguments and errors."""
    parts = griffe.Docstring(inspect.getdoc(cls) or "").parse("google", warnings=False)
    return "\n\n".join(part.value for part in parts if part.kind is griffe.DocstringSectionKind.text)


def _meanings(cls: type) -> dict[str, str]:
    """The descriptions of a constructor's parameters, those that a base class describes included."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        parts = griffe.Docstring(inspect.cleandoc(base.__doc__ or "")).parse("google", warnings=False)
        for part in parts:
            if part.kind is griffe.DocstringSectionKind.parameters:
                found |= {parameter.name: parameter.description for parameter in part.value}
    return found


def _node(cfg: DictConfig, section: str) -> dict[str, Any]:
    node: Any = cfg
    for name in section.split("."):
        node = node.get(name, {}) if node is not None else {}
    return dict(plain(node or {}, section))


def _yaml(value: Any) -> str:
    """A default as one types it on the command line."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_yaml, value))}]"
    if isinstance(value, dict) or type(value).__name__ == "_HAS_DEFAULT_FACTORY_CLASS":
        return "{}" if not isinstance(value, dict) else f"{{{', '.join(f'{k}: {_yaml(v)}' for k, v in value.items())}}}"
    return str(value)


def _line(text: str) -> str:
    """Text on one line."""
    return " ".join(text.split())


if __name__ == "__main__":
    sys.stdout.write(f"{write_reference()}\n")
