"""The walks of a study of uncertainty: one in each scene, every frame of them judged, each scene kept when done."""

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
from deux.errors import DeuxError, counted, printable
from deux.geometry.poses import motion
from deux.inference.threads import one_thread
from deux.io.atomic import make_folder, read_bytes, write_json
from deux.io.progress import Progress, ignore_progress
from deux.registry import PluginChoice, registry
from deux.simulator.simulation import Simulation
from deux.studies.judged_walk import JudgedSample, JudgedWalk, WalkJudge
from deux.studies.uncertainty_study import UncertaintyStudy

SAMPLES = 5
"""Frames of the first scene that are shown in figures."""

ShowSamples = Callable[[Sequence[JudgedSample]], None]
"""Told some frames of the first scene, at least one."""


def installed_measures() -> tuple[list[PluginChoice], dict[str, str]]:
    """All installed measures of uncertainty with their default options.

    Returns:
        The measures by name, and why those that cannot be made are left out.
    """
    measures: list[PluginChoice] = []
    left_out: dict[str, str] = {}
    for name in registry().names("uncertainties"):
        try:
            choice = registry().choose("uncertainties", {"name": name})
            choice.create()
            measures.append(choice)
        except DeuxError as error:
            left_out[name] = str(error)
        except (Exception, SystemExit) as error:  # the modules and constructors of other packages may raise anything
            left_out[name] = f"{name} cannot be made: {type(error).__name__}: {printable(str(error))}."
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
    """Hold measures of uncertainty against the true error of a depth model, along an explorer's walks.

    Args:
        folder: where each scene's numbers are kept in a file of their own; those that are there are not made again.
        simulation: makes the simulators.
        scenes: where the explorer walks, once in each, or on each floor where its `area` asks for all; at least one.
        explorer: who walks.
        predict_depth: the depth model; asked once for each frame, and again by some measures.
        sparse: how its sparse points are taken.
        measures: the measures that are judged, each name once; `installed_measures` lists all.
        seed: the run's; the seed of a walk is `episode_seed`.
        steps: actions in a walk.
        guidance: the measure that the explorer is shown, if it needs one; where it is judged as well, it is computed
            once.
        show: is given some frames of the first scene, before that scene is kept.
        progress: told the number of walks.
        correct_depth: whether the explorer is given the depth corrected by the sparse points; what is judged is not.
        remembered_frames: number of earlier frames whose points correct it as well.

    Raises:
        DeuxError: a scene cannot be read, the explorer needs a measure that was not given, the file of a scene is
            damaged, or no frame could be judged.
    """
    made: dict[str, Uncertainty] = {choice.name: choice.create() for choice in measures}
    guide: Uncertainty | None = None
    if guidance is not None and explorer.create().needs & MODEL_NEEDS:
        guide = made[guidance.name] if guidance in measures else guidance.create()
    perception = Perception(predict_depth, sparse, guide, correct_depth, remembered_frames)
    walks = _Walks(simulation, explorer, perception, made, seed, steps)
    make_folder(folder)
    judged = []
    floors = count_all_floors(scenes, folder / "floors", simulation.make)
    places = [(scene, floor) for scene in scenes for floor in range(floors[scene.name])]
    for number, (scene, floor) in enumerate(places):
        judged.append(walks.kept(folder, scene, floor, None if number else show))
        progress("scenes", number + 1, len(places))
    study = UncertaintyStudy(judged, list(made))
    if study.count() == 0:
        raise DeuxError(
            f"No frame of the {counted(len(scenes), 'scene')} could be judged: the walks show nothing within the "
            "camera's range, or their steps are too few."
        )
    return study


@dataclass(frozen=True)
class _Walks:
    """What the walks have in common, as `study_uncertainty` says."""

    simulation: Simulation
    explorer: PluginChoice
    perception: Perception
    measures: Mapping[str, Uncertainty]
    seed: int
    steps: int

    def kept(self, folder: Path, scene: SceneReference, floor: int, show: ShowSamples | None) -> JudgedWalk:
        """The walk on a floor of a scene as its file in a folder has it; without a file it is taken and kept first."""
        record = folder / f"{place_name(scene, floor)}.json"
        if not record.exists():
            found, samples = self.judge(scene, floor)
            if show is not None and samples:
                show(samples)
            write_json(record, asdict(found))
        return _read(record)

    def judge(self, scene: SceneReference, floor: int) -> tuple[JudgedWalk, list[JudgedSample]]:
        """Let the explorer walk on a floor of a scene, and judge every frame that has all its source frames."""
        seed = episode_seed(self.seed, scene, 0)
        walk = Walk(self.simulation.make(scene), self.explorer.create(), seed, self.steps, floor)
        judge = WalkJudge(scene.name, self.simulation.camera, self.measures, seed, floor)
        shown = np.linspace(SOURCES, self.steps - 1, SAMPLES, dtype=int)
        samples: list[JudgedSample] = []
        with one_thread():  # or the last bits of what is found would depend on the number of threads
            for (step,) in run_walks([walk], self.perception):
                if len(step.frames) > SOURCES:
                    maps = self._see(judge, step)
                    if maps and step.number in shown:
                        samples.append(_sample(step, maps))
        return judge.result(), samples

    def _see(self, judge: WalkJudge, step: Step) -> dict[str, np.ndarray]:
        assert step.percept is not None
        moved, turned = motion(step.frames[SOURCES].pose, step.frame.pose)
        residual = step.percept.residual
        computed = {
            name: residual
            for name, measure in self.measures.items()
            if residual is not None and measure is self.perception.uncertainty
        }
        return judge.see(step.number, step.percept.view, step.frame.depth, step.frame.pose, moved, turned, computed)


def _sample(step: Step, maps: Mapping[str, np.ndarray]) -> JudgedSample:
    assert step.percept is not None
    depth = step.percept.view.depth[0, 0].cpu().numpy()
    error = np.abs(depth - np.where(step.frame.depth > 0, step.frame.depth, np.nan))
    return JudgedSample(step.frame.rgb, error, maps)


def _read(record: Path) -> JudgedWalk:
    try:
        return JudgedWalk.from_json(json.loads(read_bytes(record)))
    except (ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it holds no judged walk ({error}): delete it.") from error
