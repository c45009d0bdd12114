"""`task=study_uncertainty`: which uncertainty points at a depth model's errors, in scenes that it never saw."""

import csv
import io
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from deux.collection.perception import SOURCES, look, perceive
from deux.collection.specification import episode_seed
from deux.collection.walk import Walk
from deux.configuration import run_folder
from deux.contracts import Frame, SceneReference
from deux.errors import DeuxError
from deux.figures.drawing import save_figure
from deux.figures.uncertainty_figures import (
    JudgedSample,
    draw_frames,
    draw_sparsification,
    draw_uncertainty_maps,
)
from deux.geometry.poses import motion
from deux.inference.precision import FastPredictor
from deux.io.atomic import make_folder, read_bytes, write_atomically, write_json
from deux.report.results import RESULTS_FILE
from deux.simulator.mesh_simulator import MeshSimulator
from deux.studies.judged_scene import JudgedScene, SceneJudge
from deux.studies.uncertainty_sheets import causes_sheet, measures_sheet
from deux.studies.uncertainty_study import UncertaintyStudy
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.run_folder import EPISODES, RunFolder
from deux.tasks.seed_model import needs_model, seed_model
from deux.tasks.settings import Settings
from deux.tasks.training import chosen_trainee

_SAMPLES = 5
"""Frames of the first scene that are drawn."""


def run(cfg: DictConfig) -> None:
    """Judge the seed model's depth along the chosen explorer's way through the test scenes.

    Scenes that an earlier attempt in the same folder finished are not walked through again.
    """
    quieten_libraries()
    settings = Settings(cfg)
    say(f"Seed model: {settings.model.name}")
    model, identity = seed_model(settings, chosen_trainee(settings))
    run = RunFolder(run_folder(), settings.identity | {"seed model": identity})
    say(f"Run folder: {run.path}")
    if not settings.splits.test:
        raise DeuxError("task=study_uncertainty walks through the test scenes, and there are none: set scenes.test.")
    say(f"Walk through {len(settings.splits.test)} test scenes with {settings.explorer.name}")
    predictor = FastPredictor(model, settings.trainer.get("accelerator", "auto"))
    make_folder(run.path / EPISODES)
    with run.stage("judge"), progress() as report:
        scenes = []
        for number, scene in enumerate(settings.splits.test):
            scenes.append(_judged(settings, scene, predictor, run, draw=number == 0))
            report("scenes", number + 1, len(settings.splits.test))
    _write(settings, UncertaintyStudy(scenes), run)


def _judged(
    settings: Settings, reference: SceneReference, predictor: FastPredictor, run: RunFolder, draw: bool
) -> JudgedScene:
    """Walk through a scene, or read what an earlier attempt found in it."""
    record = run.path / EPISODES / f"{reference.name}.json"
    if not record.exists():
        judged, samples = _walk(settings, reference, predictor)
        if draw:
            save_figure(draw_uncertainty_maps(samples), run.figures / "maps.png")
        write_json(record, asdict(judged))
    try:
        return JudgedScene.from_json(json.loads(read_bytes(record)))
    except (ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it holds no judged scene ({error}): delete it.") from error


def _walk(
    settings: Settings, reference: SceneReference, predictor: FastPredictor
) -> tuple[JudgedScene, list[JudgedSample]]:
    """Let the explorer walk, and judge every frame that has two before it."""
    simulator = MeshSimulator(reference.load(), settings.camera, settings.robot, settings.run.renderer)
    seed = episode_seed(settings.seed, reference, 0)
    walk = Walk(simulator, settings.explorer.create(), seed, settings.collect.steps)
    judge = SceneJudge(reference.name, settings.camera, seed)
    intrinsics, sampling = settings.camera.intrinsics, settings.sampling
    drawn = np.linspace(SOURCES, settings.collect.steps - 1, _SAMPLES, dtype=int)
    guided = needs_model(settings.explorer)
    samples: list[JudgedSample] = []
    history: list[Frame] = []
    while not walk.over:
        frame = walk.frame()
        history = [frame, *history[:SOURCES]]
        if len(history) > SOURCES:
            view = look([history], intrinsics, predictor, sampling)
            moved, turned = motion(history[SOURCES].pose, frame.pose)
            judge.see(walk.step, view, frame.depth, frame.pose, moved, turned)
            if walk.step in drawn:
                error = np.abs(view.depth[0, 0].numpy() - np.where(frame.depth > 0, frame.depth, np.nan))
                samples.append(JudgedSample(frame.rgb, error, judge.uncertainties(view)))
        percept = None
        if guided:
            percept = perceive([history], intrinsics, predictor, sampling, settings.collect.uncertainty)[0]
        walk.act(frame, percept)
    return judge.result(), samples


def _write(settings: Settings, study: UncertaintyStudy, run: RunFolder) -> None:
    """Write figures and tables, results.json last, and print the tables."""
    if study.count() == 0:
        raise DeuxError(
            f"No frame of the {len(study.scenes)} test scenes could be judged: the walks show nothing within the "
            "camera's range, or collect.steps is too small."
        )
    with run.stage("draw"):
        save_figure(draw_sparsification(study), run.figures / "sparsification.png")
        save_figure(draw_frames(study), run.figures / "frames.png")
    sheets = [measures_sheet(study), causes_sheet(study)]
    if study.count("moved"):
        sheets.insert(1, measures_sheet(study, "moved"))
    page = [f"# Uncertainty of {settings.model.name}: {len(study.scenes)} scenes, {settings.explorer.name}", ""]
    write_atomically(run.path / "table.md", "\n".join([*page, *(sheet.markdown() for sheet in sheets)]).encode())
    _write_frames(study, run.path / "frames.csv")
    write_json(
        run.path / RESULTS_FILE,
        {
            "task": settings.run.task,
            "model": settings.model.name,
            "explore": settings.explorer.name,
            "seed": settings.seed,
            "scenes": [scene.scene for scene in study.scenes],
            "frames": study.count(),
            "measures": study.summary(),
            "seconds": run.seconds,
        },
    )
    for sheet in sheets:
        say(sheet.rich())
    say(f"Tables, figures and every frame's numbers: {run.path}")


def _write_frames(study: UncertaintyStudy, path: Path) -> None:
    """One row for each frame and measure."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    frame_columns = ("step", "moved", "turned", "distance", "texture", "error")
    columns = ("delta", "share", "rank_correlation", "ause")
    writer.writerow(["scene", *frame_columns, "measure", *columns])
    for scene in study.scenes:
        for frame in scene.frames:
            known = [getattr(frame, column) for column in frame_columns]
            for name, judgement in frame.judgements.items():
                writer.writerow([scene.scene, *known, name, *(getattr(judgement, column) for column in columns)])
    write_atomically(path, text.getvalue().encode())
