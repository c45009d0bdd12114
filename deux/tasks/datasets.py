"""The datasets of a run: explored frames to train on, free viewpoints to validate and test on."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from deux.collection.collect_settings import CollectSettings
from deux.collection.perception import Perception, needs_model
from deux.collection.pipeline import build_dataset, read_manifest
from deux.collection.replay import replay
from deux.collection.sparse import SparseSettings
from deux.collection.specification import IDEAL_SOURCES, VIEWPOINTS, DatasetSpec, Split, fingerprint_of
from deux.collection.verification import VerificationSettings
from deux.collection.walk import Step
from deux.compilation import nothing_compiled
from deux.contracts import NO_ROBOT, DepthPredictor, FreeViewpoints, Robot, SceneReference, SceneSource, SceneSplits
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.json_files import read_json_object
from deux.io.layout import SequencePaths
from deux.registry import PluginChoice, registry
from deux.scenes.splits import check_apart, check_not_empty, identity_of, splits_of
from deux.simulator.simulation import Simulation
from deux.task_sections import Sections
from deux.tasks.console import progress, say


def read_simulation(sections: Sections) -> Simulation:
    """The simulation described by the sections `simulator`, `camera` and `robot`."""
    return Simulation(sections.read("camera", Camera), sections.read("robot", Robot), sections.plugin("simulator"))


def read_scenes(sections: Sections, needed: Sequence[str]) -> SceneSplits:
    """The scenes described by the section `scenes`.

    Args:
        sections: configuration.
        needed: the splits that must not be empty.

    Raises:
        DeuxError: a scene is missing, a needed split is empty, or a scene is in two splits although the source's option
            `allow_overlap` is not set.
    """
    chosen = sections.plugin("scenes")
    source: SceneSource = chosen.create()
    splits = splits_of(source)
    check_not_empty(splits, needed)
    if not chosen.settings.get("allow_overlap", False):
        check_apart(splits)
    return splits


def further_scenes(source: str, count: int, splits: SceneSplits) -> tuple[SceneReference, ...]:
    """Scenes that are not among the experiment's scenes.

    Args:
        source: name of a scene source.
        count: number of scenes.
        splits: the experiment's scenes.

    Raises:
        DeuxError: the source has fewer scenes.
    """
    excluded = {identity_of(scene) for scene in (*splits.train, *splits.validation, *splits.test)}
    scene_source: SceneSource = registry().choose("scenes", {"name": source}).create()
    return scene_source.further(count, excluded)


def is_ceiling(explorer: PluginChoice) -> bool:
    """Whether the explorer stands for free viewpoints, the upper bound that no robot can reach."""
    return isinstance(explorer.create(), FreeViewpoints)


def check_robot(explorer: PluginChoice, user: str) -> None:
    """Raise DeuxError if the explorer stands for free viewpoints; `user` is what needs a robot, for the message."""
    if is_ceiling(explorer):
        raise DeuxError(f"{user} moves a robot, and {NO_ROBOT}")


class Datasets:
    """Builds the datasets of a run, or reuses those of an earlier run.

    Args:
        sections: configuration; reads `simulator`, `camera`, `robot`, `scenes`, `collect`, `sampling` and
            `verification`.
        needed: the splits that must not be empty; None if the run uses no scenes.

    Raises:
        DeuxError: an option is wrong, or a needed split is empty.
    """

    def __init__(self, sections: Sections, needed: Sequence[str] | None = ()) -> None:
        self.simulation = read_simulation(sections)
        self.scenes = SceneSplits((), (), ()) if needed is None else read_scenes(sections, needed)
        self.collect = sections.read("collect", CollectSettings)
        self.sampling = sections.read("sampling", SparseSettings)
        self.verification = sections.read("verification", VerificationSettings)
        self._execute = self.collect.make_executor()
        self._seed = sections.seed
        self._root = sections.outputs / "datasets"

    def explored(
        self, explorer: PluginChoice, predictor: DepthPredictor | None = None, predictor_identity: str | None = None
    ) -> Path:
        """Frames that an explorer collects in the training scenes.

        Args:
            explorer: the explorer.
            predictor: the depth model that guides it, if it needs one.
            predictor_identity: identity of that model's weights and precision.

        Returns:
            The dataset's folder.
        """
        return self._build(self._exploration(explorer, predictor_identity), explorer, predictor)

    def explored_elsewhere(self, explorer: PluginChoice, source: str, scenes: int) -> Path:
        """Frames that an explorer collects in scenes that are not among the experiment's.

        Args:
            explorer: an explorer that needs no depth model.
            source: name of the scene source.
            scenes: number of scenes.
        """
        spec = replace(self._exploration(explorer, None), scenes=further_scenes(source, scenes, self.scenes))
        return self._build(spec, explorer)

    def explored_in_round(
        self,
        explorer: PluginChoice,
        predictor: DepthPredictor,
        predictor_identity: str,
        root: Path,
        changes: dict[str, Any],
    ) -> Path:
        """Frames that an explorer collects during training, in a round of active collection.

        Args:
            explorer: the explorer.
            predictor: the model that is being trained.
            predictor_identity: as in `explored`.
            root: folder of the datasets of all rounds.
            changes: fields of `DatasetSpec` that differ from `explored`, such as name, scenes and seed.
        """
        guided = needs_model(explorer)
        spec = replace(self._exploration(explorer, predictor_identity if guided else None), **changes)
        return self._build(spec, explorer, predictor if guided else None, root)

    def viewpoints(self, split: Literal["validation", "test"], count: int) -> Path:
        """Frames from free viewpoints spread evenly over held-out scenes, the same for every explorer.

        Args:
            split: split of the scenes.
            count: viewpoints per scene.
        """
        return self._viewpoints(split, split, getattr(self.scenes, split), count)

    def synthetic(self, source: str, scenes: int, count: int) -> Path:
        """Frames from free viewpoints in scenes that are not among the experiment's, to train a foundation on.

        Args:
            source: name of the scene source.
            scenes: number of scenes.
            count: viewpoints per scene.
        """
        return self._viewpoints("synthetic", "train", further_scenes(source, scenes, self.scenes), count)

    def replayed(
        self, sequence: SequencePaths, explorer: PluginChoice, predictor: DepthPredictor | None = None
    ) -> Iterator[Step]:
        """Replay an episode of `explored` on its stored frames, step by step.

        Args:
            sequence: the episode.
            explorer: as in `explored`.
            predictor: as in `explored`.

        Raises:
            ReplayDiverged: the explorer now acts differently.
            DeuxError: the episode was not collected in one of the training scenes.
        """
        name = read_json_object(sequence.folder / "episode.json").get("scene")
        scene = next((scene for scene in self.scenes.train if scene.name == name), None)
        if scene is None:
            raise DeuxError(f"{sequence.folder} was collected in {name}, which is not one of the training scenes.")
        perception = None
        if predictor is not None:
            measure = self.collect.measure.create()
            remembered = self.collect.remembered_frames
            perception = Perception(predictor, self.sampling, measure, self.collect.correct_depth, remembered)
        return replay(sequence, scene, self.collect.steps, self.simulation.make, explorer.create, perception)

    def _exploration(self, explorer: PluginChoice, predictor_identity: str | None) -> DatasetSpec:
        if is_ceiling(explorer):
            # The first two frames of an episode are source frames only.
            targets = max(1, self.collect.steps - 2) * self.collect.episodes
            return DatasetSpec(
                name=explorer.name,
                scenes=self.scenes.train,
                explorer=VIEWPOINTS,
                explorer_settings=IDEAL_SOURCES,
                simulation=self.simulation,
                steps=targets,
                sparse=self.sampling,
                verification=self.verification,
                seed=self._seed,
            )
        fingerprint = fingerprint_of(explorer.create())
        corrected = self.collect.correct_depth and predictor_identity is not None
        return DatasetSpec(
            name=explorer.name,
            scenes=self.scenes.train,
            explorer=explorer.name,
            explorer_settings={**explorer.settings, **({} if fingerprint is None else {"is": fingerprint})},
            simulation=self.simulation,
            steps=self.collect.steps,
            episodes=self.collect.episodes,
            sparse=self.sampling,
            verification=self.verification,
            seed=self._seed,
            model=predictor_identity,
            uncertainty=self.collect.measure if predictor_identity else None,
            correct_depth=corrected,
            remembered_frames=self.collect.remembered_frames if corrected else 0,
            # Without a model, frames do not depend on the batch size.
            batch_size=self.collect.batch_size if predictor_identity else DatasetSpec.batch_size,
        )

    def _viewpoints(self, name: str, split: Split, scenes: tuple[SceneReference, ...], count: int) -> Path:
        spec = DatasetSpec(
            name=name,
            scenes=scenes,
            explorer=VIEWPOINTS,
            simulation=self.simulation,
            steps=count,
            sparse=self.sampling,
            verification=self.verification,
            split=split,
        )
        return self._build(spec)

    def _build(
        self,
        spec: DatasetSpec,
        explorer: PluginChoice | None = None,
        predictor: DepthPredictor | None = None,
        root: Path | None = None,
    ) -> Path:
        root = root or self._root
        exists = (root / spec.folder_name).exists()
        if not exists and nothing_compiled():
            say("  compiling kernels, once on this machine; this takes some seconds")
        with progress() as report:
            dataset = build_dataset(
                spec,
                root,
                self.simulation.make,
                explorer.create if explorer else None,
                predict_depth=predictor,
                progress=report,
                execute=self._execute,
            )
        try:
            manifest = read_manifest(dataset)
        except DeuxError as error:  # of a folder that somebody copied in part or damaged
            raise DeuxError(f"{error} Delete this folder; the same command then collects it again.") from error
        say(f"  {_usable_frames(spec.name, manifest)}{', collected before' if exists else ''}: {dataset}")
        return dataset


def _usable_frames(name: str, manifest: Mapping[str, Any]) -> str:
    """Summary of how many frames can be trained on; with both choices of source frames if the numbers differ."""
    counts = manifest["baseline"]
    rejected = ", ".join(f"{count} {reason.replace('_', ' ')}" for reason, count in counts["rejected"].items())
    usable = f"{counts['triplets']} of {counts['candidates']} {name} frames usable"
    if rejected:
        usable += f" (rejected: {rejected})"
    if manifest["triplets"] != counts["triplets"]:
        usable += f", {manifest['triplets']} with training.sources=recent"
    return usable
