"""`task=experiment`: collect, train the seed model, explore with it, train the final model, evaluate."""

from omegaconf import DictConfig

from deux.collection.pipeline import read_manifest
from deux.configuration import run_folder
from deux.report.results import RESULTS_FILE, Results
from deux.tasks.active_collection import read_rounds
from deux.tasks.collect import collect
from deux.tasks.console import quieten_libraries, say
from deux.tasks.datasets import viewpoint_dataset
from deux.tasks.evaluation import draw_trajectories, evaluate_model
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings
from deux.tasks.training import chosen_trainee, train
from deux.training.ranks import leads


def run(cfg: DictConfig) -> None:
    """Run the whole experiment, from where an earlier attempt in the same folder stopped."""
    quieten_libraries()
    settings = Settings(cfg)
    run = RunFolder(run_folder(), settings.identity)
    trainee = chosen_trainee(settings)
    if (run.path / RESULTS_FILE).exists():
        say(f"This run is complete: {run.path}")
        say(Results.load(run.path).table())
        return
    say(f"Run folder: {run.path}")
    dataset = collect(settings, run, trainee)
    say(f"Train {settings.model.name} on the {settings.explorer.name} frames")
    with run.stage("train"):
        model = train(settings, trainee, settings.training, dataset, run, settings.active)
    if not leads():
        return
    say("Evaluate on free viewpoints of the test scenes")
    with run.stage("evaluate"):
        test = viewpoint_dataset(settings, "test")
        found = evaluate_model(settings, model, test, run.figures)
        draw_trajectories(settings, dataset, settings.explorer.name, run.figures)
    rounds = read_rounds(run)
    results = Results(
        model=settings.model.name,
        explore=settings.explorer.name,
        seed=settings.seed,
        frames=read_manifest(dataset)["triplets"] + sum(one.frames for one in rounds),
        metrics=found.metrics,
        baseline=found.baseline,
        constant=found.constant,
        seconds=run.seconds,
        rounds=[one.summary() for one in rounds],
    )
    results.save(run.path)
    say(results.table())
    say(f"Figures and logs: {run.path}")
