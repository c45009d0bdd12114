import pytest
import torch
from torch import nn

from deux.errors import DeuxError
from deux.training.network_compilation import compiled_networks


@pytest.mark.parametrize("mode", [True, "default", "reduce-overhead", "max-autotune"])
def test_the_names_of_the_weights_stay_and_the_network_is_given_back(mode):
    network = nn.Sequential(nn.Linear(4, 8), nn.ReLU(), nn.Linear(8, 1))
    names = list(network.state_dict())
    with compiled_networks([network], mode):
        assert network._compiled_call_impl is not None
        assert list(network.state_dict()) == names
    assert network._compiled_call_impl is None


@pytest.mark.slow
def test_it_computes_the_same():
    torch.manual_seed(0)
    network, x = nn.Sequential(nn.Linear(4, 8), nn.ReLU(), nn.Linear(8, 1)), torch.rand(5, 4)
    expected = network(x)
    with compiled_networks([network], True):
        torch.testing.assert_close(network(x), expected)
        network(x).sum().backward()
    assert network[0].weight.grad.any()


def test_a_missing_compiler_is_one_sentence(monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    network = nn.Linear(1, 1)
    message = "training.compile needs no-such-compiler, which CXX names, on the PATH: install g\\+\\+, or"
    with pytest.raises(DeuxError, match=message), compiled_networks([network], "default"):
        pass
    monkeypatch.delenv("CXX")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(DeuxError, match=r"needs a C\+\+ compiler on the PATH"), compiled_networks([network], True):
        pass
    assert network._compiled_call_impl is None


def test_it_is_off_unless_asked_for(monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    network = nn.Linear(1, 1)
    with compiled_networks([network], False):
        assert network._compiled_call_impl is None
