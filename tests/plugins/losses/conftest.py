"""The published models' reference cases, as the loss terms get them."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from deux.contracts import Batch, Prediction, Reconstructions


@pytest.fixture
def published_case(
    shared_data,
) -> Callable[[str], tuple[Batch, Prediction, Reconstructions, dict[str, float]]]:
    """From a case's name to its batch, prediction, reconstructions and unweighted loss values."""

    def load(name: str) -> tuple[Batch, Prediction, Reconstructions, dict[str, float]]:
        case = {key: torch.from_numpy(value) for key, value in np.load(shared_data("cases") / f"{name}.npz").items()}
        sources, images, poses = (
            torch.stack([case[first], case[second]], dim=1)
            for first, second in (("image1", "image2"), ("image01", "image02"), ("pose01", "pose02"))
        )
        batch = Batch(
            image=case["image0"],
            sources=sources,
            sparse_depth=case["sparse_depth"],
            validity=case["filtered_validity_map"],
            input_sparse_depth=case["sparse_depth"],
            intrinsics=case["intrinsics"],
            source_from_target=poses,
        )
        reconstructions = Reconstructions(images, torch.ones_like(images[:, :, :1], dtype=torch.bool), poses)
        losses = {key.removeprefix("loss_"): float(value) for key, value in case.items() if key.startswith("loss_")}
        return batch, Prediction(case["output_depth"]), reconstructions, losses

    return load
