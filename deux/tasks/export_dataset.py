"""`task=export_dataset`: export datasets in formats that other code reads."""

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
from deux.tasks.recorded_frames import data_digest, make_reader
from deux.tasks.run_folder import RunFolder, changed_options, open_run_folder, short_hash
from deux.training.training_settings import TrainingSettings

_RECORD = "exported.json"
"""File in the run folder that records which folder this command has exported."""


@dataclass(frozen=True)
class ExportDatasetSettings:
    """Options of the export of a dataset.

    Args:
        format: "void", "triplets" or "webdataset".
        output: the output folder.
        train: a folder whose train split is exported, read by the reader of the section `data`.
        validation: likewise, for the validation split.
        test: likewise, for the test split. With none of the three, the explorer's frames and the test viewpoints are
            exported.
        arrangement: order of the files for format=void: "triplets" so that the published set-up script finds the
            dataset's source frames, "time" for all frames as recorded.
        samples: samples per shard for format=webdataset.
        sources: choice of the source frames of training frames, "baseline" or "recent"; None for `training.sources`.

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
        """The configured folders, by split."""
        folders = {"train": self.train, "validation": self.validation, "test": self.test}
        return {split: folder for split, folder in folders.items() if folder}


def run(cfg: DictConfig) -> None:
    """Write the folder `export_dataset.output`, which must not exist yet; it appears when it is complete.

    If the same command has already written it, nothing is done.
    """
    quieten_libraries()
    sections = sections_of(cfg)
    settings = sections.read("export_dataset", ExportDatasetSettings)
    output = _output(settings)
    record = run_folder() / _RECORD
    weights = {} if settings.folders else named_weights(sections, trained=False)
    readers = {split: make_reader(sections, folder) for split, folder in settings.folders.items()}
    files: dict[str, str] = {}
    for name, reader in readers.items():
        files |= data_digest(reader, f"export_dataset.{name}", sections)
    if output.exists():
        if record.exists() and _was_exported(json.loads(record.read_text()), sections, output, weights, files):
            say(f"This export is complete: {output}")
            return
        raise DeuxError(f"export_dataset.output={settings.output} already exists: remove it or choose another folder.")
    training = sections.read("training", TrainingSettings)
    with open_run_folder(run_folder(), sections.identity, weights, files) as run:
        if not readers:
            readers = _collect(sections, run)
        splits = read_splits(readers, training.offsets, settings.sources or training.sources)
        partial = output.with_name(f".{output.name}.partial")
        shutil.rmtree(partial, ignore_errors=True)
        make_folder(partial)
        total = sum(len(split.triplets) for split in splits)
        say(f"Export {counted(total, 'frame')} as {settings.format}")
        with progress() as report:
            for done, _ in enumerate(_write(partial, output, splits, settings), start=1):
                report("export", done, total)
        write_json(record, {**_identity(sections, partial), "weights": weights, "files": files})
        partial.rename(output)
    say(str(output))
    for split in splits:
        say(f"  {split.name}: {counted(len(split.triplets), 'frame')} in {counted(len(split.sequences()), 'sequence')}")
    if settings.format == "void":
        _print_setup_usage(splits, settings.arrangement)


def _output(settings: ExportDatasetSettings) -> Path:
    if not settings.output:
        raise DeuxError("task=export_dataset needs an output folder: set export_dataset.output=.")
    return user_path(settings.output)


def _identity(sections: Sections, folder: Path) -> dict[str, Any]:
    """Identity of an export: the command's settings, and the folder's inode, which survives renaming."""
    return {"settings": short_hash(sections.identity), "inode": folder.stat().st_ino}


def _was_exported(
    record: dict[str, Any], sections: Sections, folder: Path, weights: dict[str, str], files: dict[str, str]
) -> bool:
    """Whether a record is that of an export of the same settings, weights and recorded frames to this folder."""
    recorded = {key: record.pop(key, {}) for key in ("weights", "files")}  # absent in records of earlier versions
    same = not changed_options(recorded["weights"], weights) and not changed_options(recorded["files"], files)
    return same and record == _identity(sections, folder)


def _collect(sections: Sections, run: RunFolder) -> dict[str, Reader]:
    """Collect the frames that an experiment trains and tests on."""
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


def _print_setup_usage(splits: list[ExportedSplit], arrangement: Arrangement) -> None:
    """Print how many of the exported frames the published set-up script of VOID uses."""
    used, total = used_by_setup(splits, arrangement)
    sources = "their own" if arrangement == "triplets" else f"{SOURCE_DISTANCE} frames before and after them"
    say(
        f"The published set-up script skips {MARGIN} files at either end of a training sequence and uses the files "
        f"{SOURCE_DISTANCE} places away as source frames: it uses {used} of the {counted(total, 'training frame')}, "
        f"with source frames that are {sources}."
    )
