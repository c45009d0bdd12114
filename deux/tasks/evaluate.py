"""`task=evaluate`: a trained model on the test scenes or on recorded data."""

from omegaconf import DictConfig

from deux.configuration import run_folder, user_path
from deux.errors import DeuxError
from deux.evaluation.results import Results
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import given_dataset, viewpoint_dataset
from deux.tasks.evaluation import evaluate_model
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings
from deux.training.model_files import load_model, model_name


def run(cfg: DictConfig) -> None:
    """Evaluate `evaluation.checkpoint` on the test viewpoints, or on `evaluation.data`."""
    quieten_libraries()
    settings = Settings(cfg)
    chosen = settings.evaluation
    if not chosen.checkpoint:
        raise DeuxError(
            "task=evaluate needs a trained model: name a run folder or a model file by evaluation.checkpoint=."
        )
    checkpoint = user_path(chosen.checkpoint)
    model = load_model(checkpoint)
    given = given_dataset("evaluation.data", chosen.data) if chosen.data else None
    run = RunFolder(run_folder(), settings.identity)
    with run.stage("evaluate"):
        dataset = given or viewpoint_dataset(settings, "test")
        found = evaluate_model(settings, model, dataset, run.figures)
    results = Results(
        model=model_name(checkpoint),
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
