"""The sentence about a plugin that gives what its contract does not allow."""

import torch

from deux.broken_contracts import broken_contract
from deux.contracts import LossInputs, LossTerm
from deux.registry import registry


class Nothing(LossTerm):
    def __call__(self, inputs: LossInputs) -> torch.Tensor:
        return None  # type: ignore[return-value]


def test_a_plugin_is_called_by_its_name_and_package():
    registry().register("losses", "nothing", Nothing)
    try:
        registered = registry().create("losses", "nothing", {})
    finally:
        registry().unregister("losses", "nothing")
    shipped = registry().create("losses", "sparse_depth", {})
    assert str(broken_contract(registered, "None", "a Tensor")).startswith(
        "the loss term 'nothing' of registered by hand - ("
    )
    told = str(broken_contract(shipped, "None", "a Tensor", "needs"))
    assert told.startswith("the `needs` of the loss term 'sparse_depth' of deux ")
    assert told.endswith(" gives None: it must be a Tensor.")


def test_what_was_made_by_hand_is_called_by_its_class():
    class Other(LossTerm):
        __call__ = Nothing.__call__

    assert str(broken_contract(Other(), "None", "a Tensor")) == "the loss term Other gives None: it must be a Tensor."
    assert str(broken_contract(torch.nn.ReLU(), "1", "2")) == "ReLU gives 1: it must be 2."
    assert str(broken_contract("the depth model", "1", "2", "forward")).startswith("the `forward` of the depth model g")
