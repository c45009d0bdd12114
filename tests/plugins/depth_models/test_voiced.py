"""VOICED: the suite of all depth models, and what is particular to it."""

import numpy as np
import pytest
import torch

from deux.contracts import DepthModel
from deux.errors import DeuxError
from deux.geometry.scaffolding import interpolate
from deux.testing.depth_models import DepthModelSuite, camera_data, run
from deux_plugins.depth_models.voiced import VOICED


class TestVOICED(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return VOICED()


class TestVOICEDWithMargin(DepthModelSuite):
    def make_model(self) -> DepthModel:
        return VOICED(image_filters=(4, 8, 8, 8, 8), depth_filters=(4,) * 5, decoder_filters=(8, 8, 8, 4), margin=4)


def test_a_margin_is_the_network_on_inputs_extended_by_hand():
    model, data = VOICED().eval(), camera_data((40, 56))
    scaffolding = np.stack([model.prepare(depth)["scaffolding"] for depth in data["sparse_depth"][:, 0].numpy()])

    def extended(x, mode):
        return torch.from_numpy(np.pad(np.asarray(x), ((0, 0), (0, 0), (5, 5), (5, 5)), mode=mode))

    sparse = extended(data["sparse_depth"], "constant")
    inputs = {"sparse_depth": sparse, "validity": (sparse > 0).float(), "intrinsics": data["intrinsics"]}
    with torch.no_grad():
        depth = model(extended(data["image"], "edge"), scaffolding=extended(scaffolding, "edge"), **inputs).depth
    model.margin = 5
    torch.testing.assert_close(model.predict(**data), depth[..., 5:-5, 5:-5])


def test_training_goes_without_the_margin():
    model, data = VOICED(margin=4), camera_data((40, 56))
    trained = run(model.train(), data).depth
    model.margin = 0
    torch.testing.assert_close(trained, run(model.eval(), data).depth)


def test_number_of_parameters_of_the_smaller_encoder():
    assert sum(p.numel() for p in VOICED(encoder="vggnet08").parameters()) == 6_723_440


def test_scaffolding_is_the_linear_interpolation_and_zero_outside_the_hull():
    sparse_depth = camera_data((40, 50), count=1)["sparse_depth"][0, 0].numpy()
    scaffolding = VOICED().prepare(sparse_depth)["scaffolding"]
    assert scaffolding.shape == (1, 40, 50)
    assert scaffolding.dtype == np.float32
    np.testing.assert_array_equal(scaffolding[0], interpolate(sparse_depth, outside="zero"))
    assert scaffolding[0, 0, 0] == 0.0


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_frames_with_few_points(count):
    data = camera_data((32, 48), count=1, points=0.0)
    for i in range(count):
        data["sparse_depth"][0, 0, 3 + 9 * i, 40 - 11 * i] = 2.0 + i  # on one line
    depth = VOICED().predict(**data)
    assert depth.isfinite().all()


def test_outliers_stay_in_the_network_inputs():
    """The published network sees every point; only its loss leaves the outliers out."""
    model, data = VOICED().eval(), camera_data((32, 48))
    with torch.no_grad():
        expected = run(model, data).depth
        samples = [model.prepare(depth)["scaffolding"] for depth in data["sparse_depth"][:, 0].numpy()]
        scaffolding = torch.from_numpy(np.stack(samples))
        nothing_valid = torch.zeros_like(data["sparse_depth"])
        assert torch.equal(model(**data, validity=nothing_valid, scaffolding=scaffolding).depth, expected)


def test_impossible_options_are_refused():
    with pytest.raises(DeuxError, match=r"depth_filters=\[8\] has 1 entries: it must have 5, one per level"):
        VOICED(depth_filters=(8,))
