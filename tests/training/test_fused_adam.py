"""Fused Adam on parameters of both layouts."""

import pytest
import torch

from deux.training.fused_adam import FusedAdam

LAYOUTS = [torch.contiguous_format, torch.channels_last]


@pytest.mark.parametrize("betas", [(0.9, 0.999), (0.8, 0.95)])
@pytest.mark.parametrize("gradient_layout", LAYOUTS)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_steps_are_those_of_adam_one_parameter_after_the_other(layout, gradient_layout, betas):
    generator = torch.Generator().manual_seed(0)
    start = [torch.randn(shape, generator=generator) for shape in ((8, 4, 3, 3), (8, 5, 1, 1), (8,))]
    ours = [torch.nn.Parameter(_laid_out(x, layout)) for x in start]
    theirs = [torch.nn.Parameter(x.double()) for x in start]
    fused = FusedAdam(ours, lr=0.01, betas=betas)
    plain = torch.optim.Adam(theirs, lr=0.01, betas=betas, foreach=False)
    for _ in range(4):
        for our, their in zip(ours, theirs, strict=True):
            their.grad = torch.randn(their.shape, generator=generator).double()
            our.grad = _laid_out(their.grad.float(), gradient_layout)
        fused.step()
        plain.step()
    for our, their in zip(ours, theirs, strict=True):
        torch.testing.assert_close(our.detach().double(), their.detach(), rtol=0.0, atol=1e-6)
        torch.testing.assert_close(fused.state[our]["exp_avg"].double(), plain.state[their]["exp_avg"])
        assert fused.state[our]["exp_avg_sq"].shape == our.shape


def test_gradients_are_not_copied():
    parameter = torch.nn.Parameter(_laid_out(torch.randn(64, 64, 3, 3), torch.channels_last))
    optimizer = FusedAdam([parameter], lr=0.01)
    parameter.grad = torch.randn_like(parameter)
    with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CPU]) as profile:
        optimizer.step()
    assert "aten::clone" not in {event.name for event in profile.events()}


def test_the_state_goes_on_from_that_of_adam():
    start = _laid_out(torch.randn(8, 4, 3, 3), torch.channels_last)
    gradients = [torch.randn_like(start) for _ in range(4)]
    results = []
    for kinds in ((FusedAdam, torch.optim.Adam), (torch.optim.Adam, FusedAdam), (FusedAdam, FusedAdam)):
        parameter, state = torch.nn.Parameter(start.clone()), None
        for kind, steps in zip(kinds, (gradients[:2], gradients[2:]), strict=True):
            optimizer = kind([parameter], lr=0.01)
            if state is not None:
                optimizer.load_state_dict({**optimizer.state_dict(), "state": state})
            for gradient in steps:
                parameter.grad = gradient.clone()
                optimizer.step()
            state = optimizer.state_dict()["state"]
        results.append(parameter.detach())
    torch.testing.assert_close(results[0], results[2], rtol=0.0, atol=1e-6)
    torch.testing.assert_close(results[1], results[2], rtol=0.0, atol=1e-6)


def _laid_out(tensor: torch.Tensor, layout: torch.memory_format) -> torch.Tensor:
    return tensor.contiguous(memory_format=layout) if tensor.dim() == 4 else tensor
