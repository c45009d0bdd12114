"""Runs the walks of a study of uncertainty measures and saves the evaluation of each to a file."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from deux.collection.floor_counts import count_all_floors
from deux.collection.perception import MODEL_NEEDS, SOURCES, Perception
from deux.collection.sparse import SparseSettings
from deux.collection.specification import episode_seed, place_name
from deux.collection.walk import Step, Walk, run_walks
from deux.contracts import DepthPredictor, SceneReference, Uncertainty
from deux.errors import DeuxError, counted
from deux.geometry.poses import motion
from deux.inference.threads import one_thread
from deux.io.atomic import make_folder, read_bytes, write_json
from deux.io.progress import Progress, ignore_progress
from deux.plugin_failures import creation_failure
from deux.registry import PluginChoice, registry
from deux.simulator.simulation import Simulation
from deux.studies.evaluated_walk import EvaluatedSample, EvaluatedWalk, WalkEvaluator
from deux.studies.uncertainty_study import UncertaintyStudy

SAMPLES = 5
"""Number of frames of the first scene in figures."""

ShowSamples = Callable[[Sequence[EvaluatedSample]], None]
"""Called with some frames of the first scene, at least one."""


def installed_measures() -> tuple[list[PluginChoice], dict[str, str]]:
    """All installed uncertainty measures with their default options.

    Returns:
        The measures, and the reasons why others cannot be created, by name.
    """
    measures: list[PluginChoice] = []
    left_out: dict[str, str] = {}
    for name in registry().names("uncertainties"):
        try:
            choice = registry().choose("uncertainties", {"name": name})
            choice.create()
            measures.append(choice)
        except (Exception, SystemExit) as error:  # third-party plugins may raise anything
            left_out[name] = creation_failure(name, error)
    return measures, left_out


def study_uncertainty(
    folder: Path,
    simulation: Simulation,
    scenes: Sequence[SceneReference],
    explorer: PluginChoice,
    predict_depth: DepthPredictor,
    sparse: SparseSettings,
    measures: Sequence[PluginChoice],
    seed: int,
    steps: int,
    guidance: PluginChoice | None = None,
    show: ShowSamples | None = None,
    progress: Progress = ignore_progress,
    correct_depth: bool = False,
    remembered_frames: int = 0,
) -> UncertaintyStudy:
    """Compare uncertainty measures with the true error of a depth model, along an explorer's walks.

    Args:
        folder: folder of the evaluations, a file for each walk; existing ones are not repeated.
        simulation: creates the simulators.
        scenes: the scenes, at least one; there is one walk on each floor that their `area` includes.
        explorer: the explorer.
        predict_depth: the depth model; called once for each frame, and by some measures.
        sparse: how sparse points are sampled.
        measures: the measures, with different names; `installed_measures` returns all.
        seed: seed of the run; the seed of a walk is `episode_seed`.
        steps: actions per walk.
        guidance: the measure that guides the explorer, if it needs one.
        show: called with some frames of the first scene, before its evaluation is saved.
        progress: called with the number of finished walks.
        correct_depth: whether the explorer receives depth that is corrected by the sparse points; the evaluated depth
            is not corrected.
        remembered_frames: number of earlier frames whose points correct it as well.

    Raises:
        DeuxError: a scene cannot be read, the explorer needs a measure that was not given, the file of a walk is
            damaged, or no frame could be evaluated.
    """
    created: dict[str, Uncertainty] = {choice.name: choice.create() for choice in measures}
    guide: Uncertainty | None = None
    if guidance is not None and explorer.create().needs & MODEL_NEEDS:
        guide = created[guidance.name] if guidance in measures else guidance.create()
    perception = Perception(predict_depth, sparse, guide, correct_depth, remembered_frames)
    walks = _Walks(simulation, explorer, perception, created, seed, steps)
    make_folder(folder)
    evaluated = []
    floors = count_all_floors(scenes, folder / "floors", simulation.make)
    places = [(scene, floor) for scene in scenes for floor in range(floors[scene.name])]
    for number, (scene, floor) in enumerate(places):
        evaluated.append(walks.load_or_run(folder, scene, floor, None if number else show))
        progress("scenes", number + 1, len(places))
    study = UncertaintyStudy(evaluated, list(created))
    if study.count() == 0:
        raise DeuxError(
            f"no frame of the {counted(len(scenes), 'scene')} could be evaluated: the walks show nothing within the "
            "camera's depth range, or collect.steps is too small."
        )
    return study


@dataclass(frozen=True)
class _Walks:
    """Runs walks with the same settings; the arguments are those of `study_uncertainty`."""

    simulation: Simulation
    explorer: PluginChoice
    perception: Perception
    measures: Mapping[str, Uncertainty]
    seed: int
    steps: int

    def load_or_run(self, folder: Path, scene: SceneReference, floor: int, show: ShowSamples | None) -> EvaluatedWalk:
        """Read the evaluation of a walk from its file; run the walk first if the file does not exist."""
        record = folder / f"{place_name(scene, floor)}.json"
        if not record.exists():
            walk, samples = self.run(scene, floor)
            if show is not None and samples:
                show(samples)
            write_json(record, asdict(walk))
        return _read(record)

    def run(self, scene: SceneReference, floor: int) -> tuple[EvaluatedWalk, list[EvaluatedSample]]:
        """Run a walk on a floor of a scene, and evaluate every frame that has all its source frames."""
        seed = episode_seed(self.seed, scene, 0)
        walk = Walk(self.simulation.make(scene), self.explorer.create(), seed, self.steps, floor)
        evaluator = WalkEvaluator(scene.name, self.simulation.camera, self.measures, seed, floor)
        shown = np.linspace(SOURCES, self.steps - 1, SAMPLES, dtype=int)
        samples: list[EvaluatedSample] = []
        with one_thread():  # otherwise the last bits of the results would depend on the number of threads
            for (step,) in run_walks([walk], self.perception):
                if len(step.frames) > SOURCES:
                    maps = self._evaluate(evaluator, step)
                    if maps and step.number in shown:
                        samples.append(_sample(step, maps))
        return evaluator.result(), samples

    def _evaluate(self, evaluator: WalkEvaluator, step: Step) -> dict[str, np.ndarray]:
        assert step.percept is not None
        moved, turned = motion(step.frames[SOURCES].pose, step.frame.pose)
        residual = step.percept.residual
        computed = {
            name: residual
            for name, measure in self.measures.items()
            if residual is not None and measure is self.perception.uncertainty
        }
        return evaluator.add(step.number, step.percept.view, step.frame.depth, step.frame.pose, moved, turned, computed)


def _sample(step: Step, maps: Mapping[str, np.ndarray]) -> EvaluatedSample:
    assert step.percept is not None
    depth = step.percept.view.depth[0, 0].cpu().numpy()
    error = np.abs(depth - np.where(step.frame.depth > 0, step.frame.depth, np.nan))
    return EvaluatedSample(step.frame.rgb, error, maps)


def _read(record: Path) -> EvaluatedWalk:
    try:
        return EvaluatedWalk.from_json(json.loads(read_bytes(record)))
    except (ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it is not an evaluated walk ({error}): delete it.") from error
