"""The datasets of a run: explored frames to train on, free viewpoints to validate and test on."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from deux.collection.exploration import MODEL_NEEDS
from deux.collection.pipeline import build_dataset, read_manifest
from deux.collection.specification import VIEWPOINTS, DatasetSpec, Split
from deux.contracts import DepthModel, DepthPredictor, Robot, Simulator
from deux.geometry.camera import Camera
from deux.inference.precision import FastPredictor
from deux.scenes.sources import SceneReference, synthetic_scenes
from deux.simulator.mesh_simulator import MeshSimulator
from deux.tasks.console import progress, say
from deux.tasks.settings import PluginChoice, Settings


def explored_dataset(
    settings: Settings, explorer: PluginChoice, model: DepthModel | None = None, identity: str | None = None
) -> Path:
    """The frames that an explorer collects in the training scenes; collected now if nobody has done so before.

    Args:
        settings: the run's.
        explorer: the explorer.
        model: the depth model that guides it, if it needs one.
        identity: what identifies that model's weights.
    """
    predictor = FastPredictor(model, settings.trainer.get("accelerator", "auto")) if model else None
    spec = _exploration(settings, explorer, f"{identity} in {predictor.precision}" if predictor else None)
    return _build(spec, settings, explorer, predictor)


def round_dataset(
    settings: Settings,
    root: Path,
    name: str,
    changes: Mapping[str, Any],
    predict_depth: DepthPredictor,
    identity: str,
) -> Path:
    """The frames that the configured explorer collects in a round of a training; as `explored_dataset`.

    Args:
        settings: the run's.
        root: the folder of all rounds' datasets.
        name: the round's; part of what the dataset is, so that equal weights explore anew in another round.
        changes: what differs from the first exploration, such as the scenes, the seed and the steps.
        predict_depth: the model that is being trained.
        identity: what identifies its weights and arithmetic.
    """
    guided = bool(settings.explorer.create().needs & MODEL_NEEDS)
    spec = _exploration(settings, settings.explorer, identity if guided else None)
    spec = replace(spec, name=name, **changes)
    return _build(spec, settings, settings.explorer, predict_depth if guided else None, root)


def _exploration(settings: Settings, explorer: PluginChoice, model: str | None) -> DatasetSpec:
    fingerprint = explorer.create().fingerprint()
    return DatasetSpec(
        name=explorer.name,
        scenes=settings.splits.train,
        explorer=explorer.name,
        explorer_settings=explorer.settings if fingerprint is None else {**explorer.settings, "is": fingerprint},
        camera=settings.camera,
        robot=settings.robot,
        renderer=settings.run.renderer,
        steps=settings.collect.steps,
        episodes=settings.collect.episodes,
        sparse=settings.sampling,
        verification=settings.verification,
        seed=settings.seed,
        model=model,
        uncertainty=settings.collect.uncertainty if model else None,
        together=settings.collect.together,
    )


def viewpoint_dataset(settings: Settings, split: Literal["validation", "test"]) -> Path:
    """Frames from free poses spread evenly over held-out scenes: the same for every explorer and every seed."""
    count = settings.evaluation.viewpoints if split == "test" else settings.evaluation.validation_viewpoints
    return _viewpoints(settings, split, split, getattr(settings.splits, split), count)


def synthetic_dataset(settings: Settings) -> Path:
    """Free viewpoints in generated flats that are none of the run's scenes: what a foundation is trained on."""
    scenes = synthetic_scenes(settings.foundation.flats, settings.splits)
    return _viewpoints(settings, "synthetic", "train", scenes, settings.foundation.viewpoints)


def _viewpoints(settings: Settings, name: str, split: Split, scenes: tuple[SceneReference, ...], count: int) -> Path:
    spec = DatasetSpec(
        name=name,
        scenes=scenes,
        explorer=VIEWPOINTS,
        camera=settings.camera,
        robot=settings.robot,
        renderer=settings.run.renderer,
        steps=count,
        sparse=settings.sampling,
        verification=settings.verification,
        split=split,
    )
    return _build(spec, settings)


def _build(
    spec: DatasetSpec,
    settings: Settings,
    explorer: PluginChoice | None = None,
    predictor: DepthPredictor | None = None,
    root: Path | None = None,
) -> Path:
    make_simulator = partial(
        _make_simulator, camera=settings.camera, robot=settings.robot, renderer=settings.run.renderer
    )
    root = root or settings.outputs / "datasets"
    known = (root / spec.folder_name).exists()
    with progress() as report:
        dataset = build_dataset(
            spec,
            root,
            make_simulator,
            explorer.create if explorer else None,
            predict_depth=predictor,
            progress=report,
            processes=settings.collect.processes,
        )
    manifest = read_manifest(dataset)
    rejected = ", ".join(f"{count} {reason.replace('_', ' ')}" for reason, count in manifest["rejected"].items())
    say(
        f"  {manifest['triplets']} of {manifest['candidates']} {spec.name} frames usable"
        f"{f' (rejected: {rejected})' if rejected else ''}{', collected before' if known else ''}: {dataset}"
    )
    return dataset


def _make_simulator(scene: SceneReference, camera: Camera, robot: Robot, renderer: str) -> Simulator:
    return MeshSimulator(scene.load(), camera, robot, renderer)
