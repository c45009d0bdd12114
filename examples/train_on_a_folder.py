"""Train KBNet on a folder of RGB-D frames: python examples/train_on_a_folder.py FOLDER [STEPS] [READER]

FOLDER holds images/, depth/, K.txt and poses.txt, or is laid out as another reader has it (void, nyu_v2, kitti). Writes
trained/: checkpoints, logs and model.safetensors. The same with all options: python -m deux task=train data=rgbd_folder
"""

import sys
from pathlib import Path

from deux.deployment.model_files import save_model
from deux.metrics.mean_errors import DepthErrors
from deux.registry import registry
from deux.tasks.console import quieten_libraries
from deux.training.fit import fit
from deux.training.training_settings import TrainingSettings


def main(folder: str, steps: int | str = 2000, reader: str = "rgbd_folder") -> Path:
    """Train by reprojection: the depth of the frames is read for validation only."""
    quieten_libraries()
    frames = registry().create("readers", reader, {}, Path(folder))
    options = {"margin": 4, "first_weights": "he", "max_depth": 10.0}
    model = registry().create("depth_models", "kbnet", options)
    settings = TrainingSettings(batch_size=4, steps=int(steps), validations=5)
    validation = [frames] if frames.triplets("validation", settings.offsets) else []
    output = Path("trained")
    # Started again after it was killed, it goes on from the last checkpoint there.
    fit(model, settings, [frames], validation, output, metrics=DepthErrors())
    save_model(output / "model.safetensors", model, "kbnet", options)
    return output / "model.safetensors"


if __name__ == "__main__":
    print(main(*sys.argv[1:]))
