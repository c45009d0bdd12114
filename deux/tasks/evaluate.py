"""`task=evaluate`: a trained model on the test scenes or on recorded data."""

from typing import Any

from omegaconf import DictConfig

from deux.configuration import run_folder
from deux.report.results import RESULTS_FILE, Results
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import viewpoint_dataset
from deux.tasks.evaluation import evaluate_model
from deux.tasks.given import given_dataset, needed_model
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings
from deux.tasks.trained_run import chosen_model, provenance


def run(cfg: DictConfig) -> None:
    """Evaluate `evaluation.checkpoint` on the test viewpoints, or on `evaluation.data`.

    What the same model was measured to reach on the same viewpoints before is not measured again.
    """
    quieten_libraries()
    settings = Settings(cfg)
    chosen = settings.evaluation
    checkpoint = chosen.checkpoint and chosen_model(settings, chosen.checkpoint)
    name, model = needed_model(settings, "evaluation.checkpoint", checkpoint)
    given = given_dataset("evaluation.data", chosen.data) if chosen.data else None
    run = RunFolder(run_folder(), settings.identity)
    trained = provenance(str(checkpoint))
    if given is None and _finished(run, trained):
        say(f"This run is complete: {run.path}")
        say(Results.load(run.path).table())
        return
    say(f"Evaluate {checkpoint}")
    with run.stage("evaluate"):
        dataset = given or viewpoint_dataset(settings, "test")
        found = evaluate_model(settings, model, dataset, run.figures)
    results = Results(
        model=name,
        explore=None,
        seed=settings.seed,
        frames=None,
        metrics=found.metrics,
        baseline=found.baseline,
        constant=found.constant,
        seconds=run.seconds,
        trained=trained,
    )
    results.save(run.path)
    say(results.table())


def _finished(run: RunFolder, trained: dict[str, Any]) -> bool:
    if not (run.path / RESULTS_FILE).exists():
        return False
    known = Results.load(run.path).trained
    return known is not None and known.get("weights") == trained["weights"]
