import numpy as np
import pytest
import torch

from deux.testing.host_waits import HostWait, refuse_host_waits


class Careless(torch.autograd.Function):
    """Reads a value in its backward pass."""

    @staticmethod
    def forward(ctx, x):
        return 2.0 * x

    @staticmethod
    def backward(ctx, gradient):
        return gradient * float(gradient.sum())


@pytest.fixture
def x():
    return torch.arange(16.0).view(4, 4)


WAITS = {
    "item": lambda x: x.sum().item(),
    "float": lambda x: float(x.sum()),
    "int": lambda x: int(x.sum()),
    "if": lambda x: 1 if x.sum() > 0 else 0,
    "in": lambda x: 3.0 in x,
    "format": lambda x: f"{x.sum():.3f}",
    "repr": repr,
    "tolist": lambda x: x.tolist(),
    "numpy": lambda x: x.numpy(),
    "asarray": np.asarray,
    "cpu": lambda x: x.cpu(),
    "to the host": lambda x: x.to("cpu"),
    "equal": lambda x: torch.equal(x, x),
    "allclose": lambda x: torch.allclose(x, x),
    "nonzero": lambda x: x.nonzero(),
    "where with one argument": lambda x: torch.where(x > 3.0),
    "masked_select": lambda x: x.masked_select(x > 3.0),
    "a boolean index": lambda x: x[x > 3.0],
    "unique": lambda x: x.unique(),
    "repeats": lambda x: x.repeat_interleave(torch.ones(4, dtype=torch.int64), dim=0),
    "several values at a mask": lambda x: x.clone().__setitem__(x > 11.0, x[0]),
    "a list": lambda x: torch.tensor([1.0, 2.0], device=x.device),
    "a number": lambda x: torch.as_tensor(1.0, device=x.device),
    "new_tensor": lambda x: x.new_tensor([1.0]),
    "an index that is a list": lambda x: x[:, [0, 2]],
    "an array": lambda x: torch.from_numpy(np.ones(3)),
    "inverse": lambda x: torch.linalg.inv(x + torch.eye(4)),
    "a backward pass": lambda x: Careless.apply(x.clone().requires_grad_()).sum().backward(),
}


@pytest.mark.parametrize("name", WAITS)
def test_what_would_wait_is_refused(name, x):
    with pytest.raises(HostWait, match=r"\.$"), refuse_host_waits():
        WAITS[name](x)
    WAITS[name](x)  # and is allowed again


GOES_ON = {
    "arithmetic": lambda x: (x @ x).clamp(min=1.0).nanmean(),
    "where": lambda x: torch.where(x > 3.0, x, 0.0),
    "a number at a mask": lambda x: x.clone().__setitem__(x > 3.0, 0.0),
    "a number at a place": lambda x: x.clone().__setitem__((0, slice(2)), 1),
    "made on the device": lambda x: (torch.full((), 2.0), torch.eye(3), torch.arange(3), x.new_zeros(2)),
    "places": lambda x: x[torch.arange(2, device=x.device), 1:],
    "equal repeats": lambda x: x.repeat_interleave(2, dim=0),
    "a copy that is looked at later": lambda x: x.sum().to("cpu", non_blocking=True).item(),
}


@pytest.mark.parametrize("name", GOES_ON)
def test_what_waits_for_nothing_is_allowed(name, x):
    with refuse_host_waits():
        GOES_ON[name](x)
    with torch.inference_mode(), refuse_host_waits():  # there, operators are not taken apart
        GOES_ON[name](x)


def test_a_step_with_a_fused_optimiser_waits_for_nothing(x):
    layer = torch.nn.Linear(4, 4)
    optimizer = torch.optim.Adam(layer.parameters(), fused=True)
    before = layer.weight.detach().clone()
    with refuse_host_waits():
        layer(x).square().mean().backward()
        torch.nn.utils.clip_grad_norm_(layer.parameters(), 1.0)
        optimizer.step()
    assert not torch.equal(layer.weight, before)


def test_code_for_cards_is_taken(x):
    with refuse_host_waits():
        assert not x.is_cpu
    assert x.is_cpu


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("name", sorted({*GOES_ON} - {"a copy that is looked at later"}))
def test_a_card_agrees_about_what_is_allowed(name, x):
    x = x.cuda()
    GOES_ON[name](x)
    torch.cuda.set_sync_debug_mode("error")
    try:
        GOES_ON[name](x)
    finally:
        torch.cuda.set_sync_debug_mode("default")
