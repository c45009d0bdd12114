"""What the graph itself computes is tested on a card; what surrounds it, with a stand-in that runs the step instead."""

import weakref
from contextlib import nullcontext
from dataclasses import replace

import pytest
import torch

from deux.bench.rendered_batch import batch_on
from deux.registry import registry
from deux.testing.losses import perfect_sample
from deux.training.graphed_step import MAX_GRAPHS, GraphedStep
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective
from deux.training.pose_source import make_pose_source

COMBINATIONS = [
    (name, pose)
    for name in registry().names("depth_models")
    for pose in ("simulator", "learned")
    if pose == "simulator" or registry().get("depth_models", name)().pose_network() is not None
]


def make_module(model, pose="learned"):
    torch.manual_seed(0)
    return DepthCompletion(model, make_objective(model), make_pose_source(pose, model))


@pytest.fixture
def recorded(monkeypatch):
    """Stands in for the recording: runs a step as often, and returns it as it is."""
    steps = []

    def record(step, inputs, allow_unused_input):
        assert allow_unused_input
        for _ in range(3):
            step(*inputs)
        steps.append(step)
        computed = step.forward
        step.forward = lambda *tensors: (step, computed(*tensors))[1]  # as PyTorch's, which refers to the step
        return step

    monkeypatch.setattr(torch.cuda, "make_graphed_callables", record)
    monkeypatch.setattr(torch.random, "fork_rng", lambda devices: nullcontext())
    return steps


@pytest.mark.parametrize(("name", "pose"), COMBINATIONS)
def test_a_step_taken_apart_into_tensors_is_the_same(recorded, prepared_sample, name, pose):
    model = registry().create("depth_models", name, {})
    module = make_module(model, pose).train()
    batch = prepared_sample(model, 64, 96)
    kept = {key: value.clone() for key, value in module.state_dict().items()}
    found = GraphedStep(module, module._step_values)(batch)
    module.load_state_dict(kept)
    expected = module._step_values(batch)
    assert found.total == expected.total
    assert found.total.requires_grad
    assert found.logged == expected.logged
    assert found.mean_depth == expected.mean_depth


def test_recording_leaves_the_running_statistics_alone(recorded, small_model):
    module = make_module(small_model()).train()
    module.model.layers.append(torch.nn.BatchNorm2d(1))
    before = {key: value.clone() for key, value in module.named_buffers()}
    step = GraphedStep(module, module._step_values)
    step._record(perfect_sample(1, 16, 16).batch)
    assert len(before) == 3
    for key, value in module.named_buffers():
        assert torch.equal(value, before[key])


def test_each_shape_has_a_graph_as_long_as_there_is_room(recorded, small_model):
    module = make_module(small_model()).train()
    step = GraphedStep(module, module._step_values)
    for size in (16, 24, 16, 32, 40, 48, 24, 48):
        batch = perfect_sample(1, size, 16).batch
        assert step(batch).total == module._step_values(batch).total
    assert len(recorded) == MAX_GRAPHS
    assert {step._template.image.shape[2] for step in recorded} == {16, 24, 32, 40}


def test_graphs_are_freed_and_recorded_anew(recorded, small_model):
    module = make_module(small_model()).train()
    step = GraphedStep(module, module._step_values)
    step(batch := perfect_sample(1, 16, 16).batch)
    kept = weakref.ref(recorded.pop())
    step.free()
    assert kept() is None
    assert step(batch).total == module._step_values(batch).total
    assert len(recorded) == 1


@pytest.mark.parametrize("wanted", [True, False])
def test_without_a_card_nothing_is_recorded(fit, small_model, recorded, wanted):
    model = small_model()
    module = DepthCompletion(model, make_objective(model), cuda_graphs=wanted)
    fit(module, perfect_sample(1, 16, 16).batch, 2, max_steps=2)
    assert not recorded


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize(("name", "pose"), COMBINATIONS)
def test_a_graph_has_the_gradients_of_the_step(prepared_sample, name, pose):
    model = registry().create("depth_models", name, {})
    module = make_module(model, pose).train().cuda()
    sample = prepared_sample(model, 64, 96)
    batches = [batch_on(module.device, replace(sample, image=sample.image * scale)) for scale in (1.0, 0.7)]
    step = GraphedStep(module, module._step_values)
    with torch.autocast("cuda", torch.bfloat16):
        step(batches[0]).total.backward()  # records; what follows is a replay with another batch
        expected, noise, found = (
            gradients(module, compute, batches[1]) for compute in (module._step_values, module._step_values, step)
        )
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        allowed = 0.02 * value.norm() + 3 * (noise[key] - value).norm() + 1e-6
        assert (found[key] - value).norm() < allowed, key


def gradients(module, step, batch):
    module.zero_grad()
    values = step(batch)
    values.total.backward()
    return {key: value.grad.clone() for key, value in module.named_parameters() if value.grad is not None}
