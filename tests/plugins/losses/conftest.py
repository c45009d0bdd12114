"""The published models' reference cases, as the loss terms get them."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from deux.contracts import Batch, LossInputs, Prediction, Reconstructions
from deux.testing.losses import DEPTH_RANGE

PublishedCase = tuple[LossInputs, dict[str, float]]


@pytest.fixture
def published_case(shared_data) -> Callable[[str], PublishedCase]:
    """From a case's name to the inputs of its loss terms and their unweighted values.

    ScaffNet's case has neither reconstructions (None) nor poses (the identity).
    """

    def load(name: str) -> PublishedCase:
        case = {key: torch.from_numpy(value) for key, value in np.load(shared_data("cases") / f"{name}.npz").items()}

        def pair(first: str, second: str) -> Tensor | None:
            return torch.stack([case[first], case[second]], dim=1) if first in case else None

        poses = pair("pose01", "pose02")
        batch = Batch(
            image=case["image0"],
            sources=pair("image1", "image2"),
            sparse_depth=case["sparse_depth"],
            validity=case.get("filtered_validity_map", case["validity_map"]),
            input_sparse_depth=case["sparse_depth"],
            intrinsics=case["intrinsics"],
            source_from_target=torch.eye(4).repeat(2, 2, 1, 1) if poses is None else poses,
            ground_truth=case["ground_truth"],
        )
        extras = {"prior": case["prior_depth"]} if "prior_depth" in case else {}
        images, reconstructions = pair("image01", "image02"), None
        if images is not None:
            visible = torch.ones_like(images[:, :, :1], dtype=torch.bool)
            reconstructions = Reconstructions(images, visible, poses, pair("pose10", "pose20"))
        losses = {key.removeprefix("loss_"): float(value) for key, value in case.items() if key.startswith("loss_")}
        return LossInputs(batch, Prediction(case["output_depth"], extras), reconstructions, DEPTH_RANGE), losses

    return load
