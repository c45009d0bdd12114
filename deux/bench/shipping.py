"""Make a trained model ready to ship: its weights in half precision, and its card with errors measured here.

    python -m deux.bench.shipping RUN --name kbnet-indoor --summary "..." --output FOLDER \
        --frames "Unseen flats: experiment=indoor scenes.houses=0" \
        --frames "A recorded room: data=rgbd_folder evaluation.data=FOLDER"

After the title each `--frames` has the overrides of a configuration: its test scenes, or `evaluation.data`.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from deux import __version__
from deux.command_record import IDENTITY_FILE
from deux.configuration import compose, sections_of, user_path
from deux.contracts import DepthModel, Reader
from deux.data.dataset_reader import DatasetReader
from deux.deployment.model_files import load_model, model_config, save_model
from deux.deployment.shipped_models import CARD_KEY, SUFFIX
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.io.atomic import make_folder, write_atomically
from deux.io.json_files import read_json_object
from deux.metrics.point_conditions import PointCondition, errors_under
from deux.report.model_card import CardErrors, ModelCard
from deux.report.runs import read_overrides
from deux.tasks.datasets import Datasets
from deux.tasks.evaluate import EvaluationSettings
from deux.tasks.recorded_frames import make_reader

CONDITIONS = (
    PointCondition("corners", 0.05),
    PointCondition("corners", 0.01),
    PointCondition("corners", 0.0025),
    PointCondition("corners", 0.001),
    PointCondition("corners", 0.01, noise=0.02, outliers=0.02),
    PointCondition("corners", 0.0025, noise=0.02, outliers=0.02),
    PointCondition("uniform", 0.01),
    PointCondition("grid", 0.01),
    PointCondition("lines", 0.01),
    PointCondition("clusters", 0.01),
)
"""Sparse points for which the card lists errors."""


class CardFrames(NamedTuple):
    """Test frames with ground truth.

    Args:
        title: description of the frames.
        reader: reader of the dataset; its test split is measured.
        camera: camera whose depth range limits the evaluation.
    """

    title: str
    reader: Reader
    camera: Camera


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the two files and return the exit code: 0, or 1 for a user's mistake, reported on stderr."""
    options = _parser().parse_args(arguments)
    try:
        chosen = [_frames(text) for text in options.frames]
        card = make_card(user_path(options.run), options.name, options.summary, chosen, options.count)
        ship(user_path(options.run), card, user_path(options.output))
    except DeuxError as error:
        print(f"deux: {error}", file=sys.stderr)
        return 1
    return 0


def make_card(run: Path, name: str, summary: str, frames: Sequence[CardFrames], count: int | None = None) -> ModelCard:
    """Create the card of a trained model, with errors of its weights in half precision.

    Args:
        run: run folder of the training.
        name: name of the shipped model.
        summary: one line about its purpose.
        frames: sets of frames on which it is evaluated.
        count: number of frames of each set, evenly spaced; None for all.

    Raises:
        DeuxError: the folder contains no trained model, or frames cannot be read.
    """
    model, trainings = load_model(run), _trainings(run)
    identities = [read_json_object(one / IDENTITY_FILE) for one in trainings]
    for parameter in model.parameters():
        parameter.data = parameter.data.half().float()
    return ModelCard(
        name=name,
        model=model_config(run).name,
        summary=summary,
        data="; then ".join(dict.fromkeys(_data(one) for one in identities)),
        supervised=model.supervised or any(one["training"].get("supervised", False) for one in identities),
        command=" && ".join(_command(one) for one in trainings),
        seed=identities[-1]["seed"],
        steps=sum(one["training"]["steps"] for one in identities),
        version=__version__,
        licence="MIT",
        errors=[one for chosen in frames for one in measure(model, chosen, count)],
    )


def measure(model: DepthModel, frames: CardFrames, count: int | None = None) -> Iterator[CardErrors]:
    """Measure, print and yield the errors of a model and of interpolation for each of `CONDITIONS`."""
    near, far = frames.camera.min_depth, frames.camera.max_depth
    for condition in CONDITIONS:
        found = errors_under(condition, model, frames.reader, near, far, count)
        metrics, baseline = (
            {name: round(value, 3) for name, value in errors.items()} for errors in (found.metrics, found.baseline)
        )
        one = CardErrors(frames.title, found.images, **asdict(condition), metrics=metrics, baseline=baseline)
        print(f"{one.frames}, {condition}: {_line(one.metrics)}; interpolation {_line(one.baseline)}", flush=True)
        yield one


def ship(run: Path, card: ModelCard, output: Path) -> None:
    """Write `<name>.safetensors` with weights in half precision and the card in its header, and `<name>.md`."""
    make_folder(output)
    config = model_config(run)
    header = {CARD_KEY: card.to_json()}
    save_model(output / f"{card.name}{SUFFIX}", load_model(run), config.name, config.settings, half=True, header=header)
    write_atomically(output / f"{card.name}.md", card.markdown().encode())


def _frames(text: str) -> CardFrames:
    """Test frames of a `--frames` option; missing frames of generated scenes are rendered."""
    title, colon, overrides = text.partition(":")
    if not colon:
        raise DeuxError(f"--frames {text!r} has no title: write it before a colon, and overrides after it.")
    sections = sections_of(compose(["task=evaluate", *overrides.split()]))
    settings, camera = sections.read("evaluation", EvaluationSettings), sections.read("camera", Camera)
    if settings.data is not None:
        return CardFrames(title, make_reader(sections, settings.data), camera)
    viewpoints = Datasets(sections, ["test"]).viewpoints("test", settings.viewpoints)
    return CardFrames(title, DatasetReader(viewpoints), camera)


def _data(identity: dict[str, Any]) -> str:
    """Description of a run's training data."""
    if folder := identity.get("training_data"):
        return f"recorded frames ({Path(folder).name})"
    scenes, collect, explorer = identity["scenes"], identity["collect"], identity["explore"]["name"]
    frames = f"{collect['steps'] * collect['episodes']} steps in each of {scenes['train']} scenes ({scenes['name']})"
    return f"generated scenes, nothing recorded: {explorer}, {frames}, {identity['camera']['width']} pixels wide"


def _trainings(run: Path) -> list[Path]:
    """Run folders of a training and of its predecessors (`training.start`), the earliest first."""
    start = read_json_object(run / IDENTITY_FILE)["training"].get("start")
    before = start and user_path(start)
    return [*(_trainings(before) if before and (before / IDENTITY_FILE).exists() else []), run]


def _command(run: Path) -> str:
    """Command line of a run, from the overrides that Hydra recorded."""
    return " ".join(["python -m deux", *read_overrides(run)])


def _line(errors: Mapping[str, float]) -> str:
    return " ".join(f"{name} {value:.1f}" for name, value in errors.items())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m deux.bench.shipping", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("run", help="the run folder of the training")
    parser.add_argument("--name", required=True, help="by which the model will be loaded")
    parser.add_argument("--summary", required=True, help="one line on what it is for")
    parser.add_argument("--output", required=True, help="the folder that takes the two files")
    parser.add_argument("--frames", action="append", default=[], help="TITLE: OVERRIDES, see above; once or more")
    parser.add_argument("--count", type=int, help="frames of each set; all without it")
    return parser


if __name__ == "__main__":
    sys.exit(main())
