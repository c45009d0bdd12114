import pickle
from dataclasses import fields

import numpy as np
import pytest
import torch

from deux.errors import DeuxError
from deux.policies.training_state import TrainingState, load_training_state, save_training_state


@pytest.fixture
def state():
    layer = torch.nn.Linear(3, 2)
    adam = torch.optim.Adam(layer.parameters(), 0.1)
    layer(torch.ones(3)).sum().backward()
    adam.step()
    return TrainingState(
        policy=layer.state_dict(),
        optimiser=adam.state_dict(),
        steps=4096,
        returns=(0.5, 2.25, 1e4),
        rewards=[{"weight": np.arange(6, dtype=np.float32).reshape(2, 3)}, {}],
        curve=([10, 20], [0.5, 1.5], [3.0, 4.0]),
    )


@pytest.fixture
def path(tmp_path, state):
    path = tmp_path / "checkpoint.pt"
    save_training_state(path, state)
    return path


def test_everything_comes_back(path, state):
    found = load_training_state(path)
    torch.testing.assert_close(dict(found.policy), dict(state.policy), rtol=0.0, atol=0.0)
    torch.testing.assert_close(found.optimiser["state"], state.optimiser["state"], rtol=0.0, atol=0.0)
    assert found.optimiser["param_groups"] == state.optimiser["param_groups"]
    assert (found.steps, found.returns, found.curve) == (state.steps, state.returns, state.curve)
    assert [set(reward) for reward in found.rewards] == [{"weight"}, set()]
    np.testing.assert_array_equal(found.rewards[0]["weight"], state.rewards[0]["weight"])
    assert found.rewards[0]["weight"].dtype == np.float32


def resave(path, change):
    content = torch.load(path, weights_only=True)
    torch.save(change(content), path)


DAMAGES = {
    "empty": lambda path: path.write_bytes(b""),
    "ten bytes": lambda path: path.write_bytes(path.read_bytes()[:10]),
    "half": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "all but a byte": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "noise": lambda path: path.write_bytes(np.random.default_rng(0).bytes(5000)),
    "no steps": lambda path: resave(path, lambda content: {k: v for k, v in content.items() if k != "steps"}),
    "something else": lambda path: resave(path, lambda content: content | {"epoch": 3}),
    "a tensor": lambda path: resave(path, lambda content: torch.zeros(3)),
    "a list": lambda path: resave(path, lambda content: [content]),
    "rewards that are none": lambda path: resave(path, lambda content: content | {"rewards": [torch.zeros(3)]}),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_checkpoint_is_reported_in_one_sentence(path, damage):
    DAMAGES[damage](path)
    with pytest.raises(DeuxError) as caught:
        load_training_state(path)
    message = str(caught.value)
    assert message.startswith(f"{path} is damaged (")
    assert message.endswith("): delete it to train from zero.")
    assert "\n" not in message


def test_a_checkpoint_that_would_run_code_is_refused(path, tmp_path, state):
    class Trap:
        def __reduce__(self):
            return (tmp_path.joinpath("sprung").touch, ())

    content = {field.name: getattr(state, field.name) for field in fields(state)}
    torch.save(content | {"policy": Trap()}, path)
    with pytest.raises(DeuxError, match="is damaged"):
        load_training_state(path)
    path.write_bytes(pickle.dumps(Trap(), protocol=2))
    with pytest.raises(DeuxError, match="is damaged"):
        load_training_state(path)
    assert not (tmp_path / "sprung").exists()
