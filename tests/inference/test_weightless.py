import subprocess
import sys

import pytest
from torch import nn

from deux.inference.weightless import without_weights
from deux.registry import registry

INITIALISATIONS = (nn.init.xavier_normal_, nn.init.kaiming_uniform_, nn.init.trunc_normal_, nn.init.orthogonal_)


@pytest.mark.parametrize("initialise", INITIALISATIONS)
def test_initialisation_is_left_out(initialise):
    with without_weights():
        layer = nn.Linear(3, 5)
        assert initialise(layer.weight) is layer.weight
        assert nn.init.normal_(tensor=layer.bias, std=2.0) is layer.bias
    assert layer.weight.is_meta
    assert not initialise(nn.Linear(3, 5).weight).is_meta  # outside all is as before


def test_structure_and_shapes_are_those_of_the_network_with_weights():
    for name in registry().names("depth_models"):
        with without_weights():
            outline = registry().create("depth_models", name, {})
        model = registry().create("depth_models", name, {})
        assert all(parameter.is_meta for parameter in outline.parameters())
        assert {key: value.shape for key, value in outline.state_dict().items()} == {
            key: value.shape for key, value in model.state_dict().items()
        }


def test_it_does_not_wait_for_the_compiler():
    code = (
        "import sys\nfrom deux.inference.weightless import without_weights\nfrom deux.registry import registry\n"
        "with without_weights():\n    registry().create('depth_models', 'kbnet', {})\n"
        "assert 'torch' in sys.modules and 'torch._dynamo' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
