"""Measure a model on test frames: python examples/evaluate_a_checkpoint.py MODEL FOLDER [READER [OPTION=VALUE ...]]

MODEL is a run folder, a model file, or for the authors' published checkpoints a .pth file with its model's name, whose
options the file does not hold: kbnet:kbnet-void1500.pth FOLDER void model.max_depth=8. Ground truth counts from 0.1 to
10 m unless camera.min_depth=0.2 camera.max_depth=5 say otherwise. Prints the four errors, beside interpolation's.
"""

import sys
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

import deux
from deux.data.datamodule import TripletDataModule
from deux.metrics.model_errors import Evaluation, evaluate
from deux.registry import registry

UNITS = {"mae": "mm", "rmse": "mm", "imae": "1/km", "irmse": "1/km"}


def main(checkpoint: str, folder: str, reader: str = "rgbd_folder", *options: str) -> Evaluation:
    """Evaluate, and print a line for each error."""
    given: Any = OmegaConf.to_container(OmegaConf.from_dotlist(list(options)))
    name, _, path = checkpoint.rpartition(":")
    model = deux.load_published(name, path, settings=given.get("model")) if name else deux.load(path)
    frames = registry().create("readers", reader, {}, Path(folder))
    data = TripletDataModule(model, test=[frames], batch_size=4)
    found = evaluate(model, data.test_dataloader(), **given.get("camera", {}))
    print(f"{found.images} frames".ljust(16) + "model".rjust(12) + "interpolated".rjust(16))
    for metric, unit in UNITS.items():
        row = f"{metric.upper()} [{unit}]".ljust(16)
        print(f"{row}{found.metrics[metric]:12.1f}{found.baseline[metric]:16.1f}")
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
