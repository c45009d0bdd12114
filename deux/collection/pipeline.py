"""Builds a dataset from its specification, in four stages, unless it exists."""

import logging
import os
import shutil
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deux.collection.episodes import EpisodePlan, MakeExplorer, MakeSimulator
from deux.collection.exploration import explore
from deux.collection.floor_counts import count_all_floors
from deux.collection.jobs import Executor, run_here
from deux.collection.sparse import sample_sequences
from deux.collection.specification import IDEAL_SOURCES, VIEWPOINTS, DatasetSpec, place_name
from deux.collection.verification import Verdicts, verify_sequences
from deux.collection.viewpoints import ViewpointPlan, collect_viewpoints, plan_viewpoints
from deux.contracts import DepthPredictor
from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_atomically, write_json
from deux.io.json_files import read_json_object
from deux.io.layout import MANIFEST, PUBLISHED_KINDS, SUFFIXES, TRIPLET_LISTS, SourceChoice, list_file, sequences
from deux.io.locking import clear_abandoned, locked
from deux.io.progress import Progress, ignore_progress

_FLOORS = "floors"
"""Folder of an unfinished dataset with the number of floors of each scene."""

log = logging.getLogger(__name__)


def build_dataset(
    spec: DatasetSpec,
    root: Path,
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer | None = None,
    predict_depth: DepthPredictor | None = None,
    progress: Progress = ignore_progress,
    execute: Executor = run_here,
) -> Path:
    """Return the folder `<root>/<name>-<hash>` of a dataset, which is collected first if it does not exist.

    It is collected in the hidden folder `.<name>-<hash>.partial` beside it, which is renamed when it is complete. A
    build that was killed is resumed. If two processes request the same dataset, the second waits for the first.

    Args:
        spec: the specification; its hash alone decides whether the dataset exists.
        root: the folder of all datasets.
        make_simulator: creates the simulator of one of the specification's scenes.
        make_explorer: creates an explorer; required unless the specification is for viewpoints.
        predict_depth: the depth model, for explorers that need it.
        progress: called with each stage's progress.
        execute: runs the jobs of episodes or viewpoints, see `explore`.

    Raises:
        DeuxError: the dataset cannot be made, such as on a full disk, or no frame of it passes verification.
    """
    dataset, lock_file = root / spec.folder_name, root / f".{spec.folder_name}.lock.json"
    if dataset.exists():
        clear_abandoned(lock_file)
        return dataset
    partial = root / f".{spec.folder_name}.partial"
    make_folder(root)
    with locked(lock_file, f"collects {spec.folder_name}") as lock:
        if dataset.exists():
            return dataset
        log.info("collecting %s", spec.folder_name)
        make_folder(partial / "data")
        times = _StageTimes()
        _explore(spec, partial, make_simulator, make_explorer, predict_depth, progress, execute)
        times.end_stage("exploration")
        _prepare(spec, partial, times, progress)
        shutil.rmtree(partial / _FLOORS, ignore_errors=True)
        lock.confirm()
        os.replace(partial, dataset)
    return dataset


def read_manifest(dataset: Path) -> dict[str, Any]:
    """Read the manifest of a dataset that `build_dataset` made.

    Raises:
        DeuxError: there is none.
    """
    try:
        return read_json_object(dataset / MANIFEST)
    except DeuxError as error:
        raise DeuxError(
            f"{dataset} holds no readable {MANIFEST}, so it is no dataset that deux collected: {error}"
        ) from error


def frame_count(dataset: Path, choice: SourceChoice) -> int:
    """The number of frames of a dataset that can be trained on, for a choice of source frames.

    Raises:
        DeuxError: there is no manifest, or it lacks the number.
    """
    manifest = read_manifest(dataset)
    counted = manifest if choice == "recent" else manifest.get("baseline", manifest)  # absent before version 6
    count = counted.get("triplets") if isinstance(counted, dict) else None
    if type(count) is not int or count < 0:
        raise DeuxError(f"{dataset / MANIFEST} is damaged: it does not say how many triplets there are.")
    return count


def _explore(
    spec: DatasetSpec,
    partial: Path,
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer | None,
    predict_depth: DepthPredictor | None,
    progress: Progress,
    execute: Executor,
) -> None:
    """Stage 1: the frames of all episodes, or of all viewpoints."""
    _check_names(spec, [scene.name for scene in spec.scenes])
    floors = count_all_floors(spec.scenes, partial / _FLOORS, make_simulator, execute, progress)
    _check_names(spec, [place_name(scene, k) for scene in spec.scenes for k in range(floors[scene.name])])
    if spec.explorer == VIEWPOINTS:
        collect_viewpoints(_viewpoint_plans(spec, partial, floors), make_simulator, execute, progress)
        return
    assert make_explorer is not None
    explore(
        _episode_plans(spec, partial, floors),
        make_simulator,
        make_explorer,
        predict_depth,
        sparse=spec.sparse,
        uncertainty=spec.uncertainty.create() if spec.uncertainty else None,
        correct_depth=spec.correct_depth,
        remembered_frames=spec.remembered_frames,
        batch_size=spec.batch_size,
        execute=execute,
        progress=progress,
    )


def _prepare(spec: DatasetSpec, partial: Path, times: "_StageTimes", progress: Progress) -> None:
    """Stages 2 to 4 and the manifest."""
    found = sequences(partial)
    sample_sequences(found, spec.sparse, progress)
    times.end_stage("sparse depth")
    viewpoints = spec.explorer == VIEWPOINTS
    verdicts = verify_sequences(found, spec.verification, spec.sparse, every_frame=not viewpoints, progress=progress)
    times.end_stage("verification")
    frames = {paths.name: len(paths.frames()) for paths in found}
    write_lists(partial, spec.folder_name, spec.split, verdicts)
    times.end_stage("preprocessing")
    recent, baseline = (_counted(verdicts, choice) for choice in ("recent", "baseline"))
    if not recent["triplets"]:
        reasons = ", ".join(f"{count} {reason.replace('_', ' ')}" for reason, count in recent["rejected"].items())
        raise DeuxError(
            f"Dataset {spec.folder_name} has no frame that passes verification ({reasons or 'there are too few'}): "
            "collect more steps or loosen the settings under verification."
        )
    manifest = {
        "name": spec.name,
        "hash": spec.key(),
        "specification": spec.description(),
        "sequences": frames,
        "frames": sum(frames.values()),
        **recent,
        "baseline": baseline,
        "seconds": times.seconds,
    }
    write_json(partial / MANIFEST, manifest)


def _counted(verdicts: Mapping[str, Verdicts], choice: SourceChoice) -> dict[str, Any]:
    """The numbers of accepted and rejected frames, for the manifest."""
    candidates = [one for verdict in verdicts.values() for one in verdict[choice].values()]
    accepted = [one for one in candidates if one.rejection is None]
    return {
        "candidates": len(candidates),
        "triplets": len(accepted),
        "parallax": sum(one.parallax for one in accepted),
        "rejected": dict(sorted(Counter(str(one.rejection) for one in candidates if one.rejection).items())),
    }


def write_lists(dataset: Path, name: str, split: str, verdicts: Mapping[str, Verdicts]) -> None:
    """Stage 4: write a split's six list files, as in the VOID release, and its two triplet lists.

    Each line of a list file is the path of a target frame's file, relative to the dataset's parent folder. Each line of
    a triplet list contains the image paths of a target and its source frames, separated by tabs. The six lists and the
    triplet list of recent source frames have the same targets in the same order; the list by baseline has its own
    targets, since verification depends on the source frames.

    Args:
        dataset: the dataset's current folder.
        name: the final name of that folder.
        split: "train", "validation" or "test".
        verdicts: the verdicts of each sequence, by its name.
    """
    lines: dict[str, list[str]] = {kind: [] for kind in (*PUBLISHED_KINDS, "intrinsics", *TRIPLET_LISTS.values())}
    for sequence, verdict in verdicts.items():
        folder = f"{name}/data/{sequence}"
        for choice, kind in TRIPLET_LISTS.items():
            for target, one in verdict[choice].items():
                if one.rejection is None:
                    images = (f"{folder}/image/{frame}{SUFFIXES['image']}" for frame in (target, *one.sources))
                    lines[kind].append("\t".join(images))
        for target in (target for target, one in verdict["recent"].items() if one.rejection is None):
            for kind in PUBLISHED_KINDS:
                lines[kind].append(f"{folder}/{kind}/{target}{SUFFIXES[kind]}")
            lines["intrinsics"].append(f"{folder}/K.txt")
    for kind, content in lines.items():
        write_atomically(list_file(dataset, split, kind), "".join(f"{line}\n" for line in content).encode())


def _episode_plans(spec: DatasetSpec, partial: Path, floors: Mapping[str, int]) -> list[EpisodePlan]:
    return [
        EpisodePlan(
            folder=partial / "data" / f"{place_name(scene, floor)}-{episode:02d}",
            scene=scene,
            seed=spec.episode_seed(scene, episode),
            steps=spec.steps,
            floor=floor,
        )
        for scene in spec.scenes
        for floor in range(floors[scene.name])
        for episode in range(spec.episodes)
    ]


def _viewpoint_plans(spec: DatasetSpec, partial: Path, floors: Mapping[str, int]) -> list[tuple[ViewpointPlan, ...]]:
    ideal = dict(spec.explorer_settings) == IDEAL_SOURCES
    return [
        plan_viewpoints(partial / "data", scene, spec.episode_seed(scene, 0), spec.steps, floor, ideal)
        for scene in spec.scenes
        for floor in range(floors[scene.name])
    ]


def _check_names(spec: DatasetSpec, names: list[str]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise DeuxError(
            f"Two scenes of dataset {spec.name}, or a scene and a floor of another, are named {twice[0]}: their frames "
            "need names of their own."
        )


class _StageTimes:
    """Measures the seconds of each stage; only this run's, if the build was resumed."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def end_stage(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage], self._last = round(now - self._last, 3), now
