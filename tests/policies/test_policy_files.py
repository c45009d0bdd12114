import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file, save_file

from deux.environment.egocentric import Crops
from deux.errors import DeuxError
from deux.policies.policy_files import load_policy, policy_identity, save_policy
from deux.testing.learned_explorers import untrained_policy

POLICY = replace(
    untrained_policy(Crops(near=3.0, far=9.0, pixels=16)),
    resolution=0.2,
    reward_state={"bias": np.array([1.0, -2.5], np.float32)},
    made_by={"reward": "curiosity", "curve": {"steps": [100, 200]}, "options": {}},
)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "policy.safetensors"
    save_policy(path, POLICY)
    return path


def test_a_policy_comes_back_but_for_the_rounding_to_half_precision(path):
    found = load_policy(path)
    assert (found.crops, found.resolution, found.made_by) == (POLICY.crops, 0.2, POLICY.made_by)
    np.testing.assert_array_equal(found.reward_state["bias"], [1.0, -2.5])
    assert not found.network.training
    weights, read = POLICY.network.state_dict(), found.network.state_dict()
    assert weights.keys() == read.keys()
    for name, weight in weights.items():
        assert read[name].dtype == torch.float32
        torch.testing.assert_close(read[name], weight.half().float(), rtol=0.0, atol=0.0)
    assert sum(weight.numel() for weight in weights.values()) * 2 == pytest.approx(path.stat().st_size, rel=0.1)


def test_writing_what_was_read_changes_nothing(path, tmp_path):
    again = tmp_path / "again.safetensors"
    save_policy(again, load_policy(path))
    assert again.read_bytes() == path.read_bytes()
    assert policy_identity(again) == policy_identity(path)


def test_reading_and_writing_take_no_pickle(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise AssertionError("pickle was used")

    for name in ("load", "loads", "dump", "dumps", "Unpickler", "Pickler"):
        monkeypatch.setattr(pickle, name, fail)
    monkeypatch.setattr(torch, "load", fail)
    save_policy(tmp_path / "policy.safetensors", POLICY)
    load_policy(tmp_path / "policy.safetensors")


def test_a_pickle_is_refused_and_not_run(tmp_path):
    class Trap:
        def __reduce__(self):
            return (tmp_path.joinpath("sprung").touch, ())

    path = tmp_path / "policy.safetensors"
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(DeuxError, match="is not a policy file"):
        load_policy(path)
    assert not (tmp_path / "sprung").exists()


def cut(path, length):
    path.write_bytes(path.read_bytes()[:length])


def rewrite(path, change):
    """Let `change` alter the tensors and the header before they are written again."""
    tensors = load_file(path)
    header = {
        "crops": {"near": 3.0, "far": 9.0, "pixels": 16},
        "resolution": 0.2,
        "made_by": {},
    }
    metadata = {"deux_policy": header}
    change(tensors, header, metadata)
    save_file(tensors, path, {name: json.dumps(value) for name, value in metadata.items()})


DAMAGES = {
    "empty": lambda path: cut(path, 0),
    "five bytes": lambda path: cut(path, 5),
    "half a header": lambda path: cut(path, 200),
    "half of the weights": lambda path: cut(path, path.stat().st_size // 2),
    "all but a byte": lambda path: cut(path, path.stat().st_size - 1),
    "noise": lambda path: path.write_bytes(np.random.default_rng(0).bytes(5000)),
    "a text": lambda path: path.write_text("version https://git-lfs.github.com/spec/v1\n"),
    "no header of ours": lambda path: rewrite(path, lambda t, h, metadata: metadata.clear()),
    "a header that is a list": lambda path: rewrite(path, lambda t, h, metadata: metadata.update(deux_policy=[1])),
    "no crops": lambda path: rewrite(path, lambda t, header, m: header.pop("crops")),
    "unknown crops": lambda path: rewrite(path, lambda t, header, m: header["crops"].update(middle=1.0)),
    "crops of another size": lambda path: rewrite(path, lambda t, header, m: header["crops"].update(pixels=32)),
    "crops of no size": lambda path: rewrite(path, lambda t, header, m: header["crops"].update(pixels=30)),
    "crops that are no number": lambda path: rewrite(path, lambda t, header, m: header["crops"].update(pixels="16")),
    "no resolution": lambda path: rewrite(path, lambda t, header, m: header.update(resolution=None)),
    "cells of no size": lambda path: rewrite(path, lambda t, header, m: header.update(resolution=0.0)),
    "no maker": lambda path: rewrite(path, lambda t, header, m: header.pop("made_by")),
    "a weight missing": lambda path: rewrite(path, lambda tensors, h, m: tensors.pop("policy.action.bias")),
    "a weight too many": lambda path: rewrite(path, lambda tensors, h, m: tensors.update({"policy.x": np.zeros(3)})),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_reported_in_one_sentence(path, damage):
    DAMAGES[damage](path)
    with pytest.raises(DeuxError) as caught:
        load_policy(path)
    message = str(caught.value)
    assert message.startswith(f"{path} is not a policy file of task=train_explorer (")
    assert message.endswith(").")
    assert "\n" not in message


def test_a_missing_file_is_reported(tmp_path):
    for read in (load_policy, policy_identity):
        for path in (tmp_path / "missing.safetensors", tmp_path):
            with pytest.raises(DeuxError, match=f"there is no policy file {path}: task=train_explorer makes one"):
                read(path)


def test_any_change_of_the_file_changes_its_identity(path):
    before = policy_identity(path)
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    assert policy_identity(path) != before
    assert len(before) == 16


def test_a_file_appears_whole_or_not_at_all(path, tmp_path, monkeypatch):
    before = path.read_bytes()

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("deux.io.atomic.os.replace", fail)
    with pytest.raises(DeuxError):
        save_policy(path, untrained_policy(seed=1))
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["policy.safetensors"]
