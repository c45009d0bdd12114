"""`task=export_dataset`: datasets in the layouts that foreign code reads."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of, user_path
from deux.contracts import Reader
from deux.data.dataset_reader import DatasetReader
from deux.data.exported_split import ExportedSplit, read_splits
from deux.data.shard_export import write_shards
from deux.data.triplet_export import write_triplets
from deux.data.void_export import MARGIN, SOURCE_DISTANCE, Arrangement, used_by_setup, write_void
from deux.errors import DeuxError, check_range, counted
from deux.io.atomic import make_folder, write_json
from deux.io.layout import SourceChoice
from deux.task_sections import Sections
from deux.tasks.collect import GuidedCollection
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.datasets import Datasets
from deux.tasks.evaluate import EvaluationSettings
from deux.tasks.model_training import Training
from deux.tasks.named_weights import named_weights
from deux.tasks.recorded_frames import given_files, read_given
from deux.tasks.run_folder import RunFolder, changed, open_run_folder, short_hash
from deux.training.training_settings import TrainingSettings

_EXPORTED = "exported.json"
"""The file in the run folder that tells which folder this command has made."""


@dataclass(frozen=True)
class ExportDatasetSettings:
    """What is exported, and how.

    Args:
        format: "void", "triplets" or "webdataset".
        output: the folder that is made.
        train: a folder whose train split is exported, read as `data` says.
        validation: likewise, for the validation split.
        test: likewise, for the test split. With none of the three, what the explorer collects and the test viewpoints
            are exported.
        arrangement: of the files of format=void: "triplets" where the published set-up script is to find the source
            frames that the dataset lists, "time" for all frames as they were recorded.
        samples: of a shard of format=webdataset.
        sources: how the source frames of training frames are chosen, "baseline" or "recent"; None for the training's.

    Raises:
        DeuxError: a value is out of its range.
    """

    format: Literal["void", "triplets", "webdataset"]
    output: str | None
    train: str | None
    validation: str | None
    test: str | None
    arrangement: Arrangement
    samples: int
    sources: SourceChoice | None

    def __post_init__(self) -> None:
        check_range("export_dataset.samples", self.samples, 1)

    @property
    def folders(self) -> dict[str, str]:
        """The folder of each split that was named."""
        named = {"train": self.train, "validation": self.validation, "test": self.test}
        return {split: folder for split, folder in named.items() if folder}


def run(cfg: DictConfig) -> None:
    """Write the folder `export_dataset.output`, which must not be there yet; it appears when it is complete.

    A command that has made it, and was perhaps killed just then, finds it again.
    """
    quieten_libraries()
    sections = sections_of(cfg)
    settings = sections.read("export_dataset", ExportDatasetSettings)
    output = _output(settings)
    record = run_folder() / _EXPORTED
    weights = {} if settings.folders else named_weights(sections, trained=False)
    readers = {split: read_given(sections, folder) for split, folder in settings.folders.items()}
    files: dict[str, str] = {}
    for name, reader in readers.items():
        files |= given_files(reader, f"export_dataset.{name}", sections)
    if output.exists():
        if record.exists() and _has_made(json.loads(record.read_text()), sections, output, weights, files):
            say(f"This export is complete: {output}")
            return
        raise DeuxError(f"export_dataset.output={settings.output} is there already: remove it or name another folder.")
    training = sections.read("training", TrainingSettings)
    with open_run_folder(run_folder(), sections.identity, weights, files) as run:
        if not readers:
            readers = _collected(sections, run)
        splits = read_splits(readers, training.offsets, settings.sources or training.sources)
        partial = output.with_name(f".{output.name}.partial")
        shutil.rmtree(partial, ignore_errors=True)
        make_folder(partial)
        total = sum(len(split.triplets) for split in splits)
        say(f"Export {counted(total, 'frame')} as {settings.format}")
        with progress() as report:
            for done, _ in enumerate(_write(partial, output, splits, settings), start=1):
                report("export", done, total)
        write_json(record, {**_made_by(sections, partial), "weights": weights, "files": files})
        partial.rename(output)
    say(str(output))
    for split in splits:
        say(f"  {split.name}: {counted(len(split.triplets), 'frame')} in {counted(len(split.sequences()), 'sequence')}")
    if settings.format == "void":
        _say_what_setup_takes(splits, settings.arrangement)


def _output(settings: ExportDatasetSettings) -> Path:
    if not settings.output:
        raise DeuxError("task=export_dataset needs a folder to make: export_dataset.output=.")
    return user_path(settings.output)


def _made_by(sections: Sections, folder: Path) -> dict[str, Any]:
    """What identifies a folder, before and after it is renamed, and the command that has made it."""
    return {"settings": short_hash(sections.identity), "inode": folder.stat().st_ino}


def _has_made(
    record: dict[str, Any], sections: Sections, folder: Path, weights: dict[str, str], files: dict[str, str]
) -> bool:
    """Whether a command's record says that it has made a folder, with the same weights and of the same recordings."""
    known = {key: record.pop(key, {}) for key in ("weights", "files")}  # which earlier versions did not record
    same = not changed(known["weights"], weights) and not changed(known["files"], files)
    return same and record == _made_by(sections, folder)


def _collected(sections: Sections, run: RunFolder) -> dict[str, Reader]:
    """What an experiment trains and tests on."""
    datasets = Datasets(sections, ["train"])
    evaluation = sections.read("evaluation", EvaluationSettings)
    training = Training(sections, datasets, evaluation.validation_viewpoints)
    readers: dict[str, Reader] = {"train": DatasetReader(GuidedCollection(sections, datasets, training).collect(run))}
    if datasets.scenes.test:
        readers["test"] = DatasetReader(datasets.viewpoints("test", evaluation.viewpoints))
    return readers


def _write(folder: Path, final: Path, splits: list[ExportedSplit], settings: ExportDatasetSettings) -> Iterator[None]:
    if settings.format == "void":
        return write_void(folder, splits, settings.arrangement)
    if settings.format == "triplets":
        return write_triplets(folder, splits, final)
    return write_shards(folder, splits, settings.samples)


def _say_what_setup_takes(splits: list[ExportedSplit], arrangement: Arrangement) -> None:
    used, total = used_by_setup(splits, arrangement)
    sources = "their own" if arrangement == "triplets" else f"{SOURCE_DISTANCE} frames before and after them"
    say(
        f"The published set-up script leaves out {MARGIN} files at either end of a training sequence and takes the "
        f"files {SOURCE_DISTANCE} places away as source frames: it uses {used} of the "
        f"{counted(total, 'training frame')}, with source frames that are {sources}."
    )
