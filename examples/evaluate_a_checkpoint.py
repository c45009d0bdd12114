"""Measure a model on the test frames of a folder: python examples/evaluate_a_checkpoint.py MODEL FOLDER [READER]

MODEL is a run folder, a model file, or for the authors' published checkpoints a .pth file with its model's name, as in
kbnet:kbnet-void1500.pth. Prints the four errors, beside those of interpolation of the sparse points.
"""

import sys
from pathlib import Path

import deux
from deux.data.datamodule import TripletDataModule
from deux.metrics.model_errors import Evaluation, evaluate
from deux.registry import registry

UNITS = {"mae": "mm", "rmse": "mm", "imae": "1/km", "irmse": "1/km"}


def main(checkpoint: str, folder: str, reader: str = "rgbd_folder") -> Evaluation:
    """Evaluate, and print a line for each error."""
    name, _, path = checkpoint.rpartition(":")
    model = deux.load_published(name, path) if name else deux.load(path)
    frames = registry().create("readers", reader, {}, Path(folder))
    data = TripletDataModule(model, test=[frames], batch_size=4)
    found = evaluate(model, data.test_dataloader())
    print(f"{found.images} frames".ljust(16) + "model".rjust(12) + "interpolated".rjust(16))
    for metric, unit in UNITS.items():
        row = f"{metric.upper()} [{unit}]".ljust(16)
        print(f"{row}{found.metrics[metric]:12.1f}{found.baseline[metric]:16.1f}")
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
