"""`task=evaluate`: a trained model on the test scenes or on recorded data."""

from omegaconf import DictConfig

from deux.configuration import run_folder
from deux.evaluation.results import Results
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import viewpoint_dataset
from deux.tasks.evaluation import evaluate_model
from deux.tasks.given import given_dataset, needed_model
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings


def run(cfg: DictConfig) -> None:
    """Evaluate `evaluation.checkpoint` on the test viewpoints, or on `evaluation.data`."""
    quieten_libraries()
    settings = Settings(cfg)
    chosen = settings.evaluation
    name, model = needed_model(settings, "evaluation.checkpoint", chosen.checkpoint)
    given = given_dataset("evaluation.data", chosen.data) if chosen.data else None
    run = RunFolder(run_folder(), settings.identity)
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
    )
    results.save(run.path)
    say(results.table())
