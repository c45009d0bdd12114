"""Model files, checkpoints and policies that are wrong on purpose."""

import io
import json
import os
import pickle
import re
import struct

import numpy as np
import pytest
import safetensors.torch
import torch
from hostile import NO_JSON, VALUES, Case, changed_values, damaged_bytes

from deux.deployment.model_files import METADATA_KEY, load_model, save_model
from deux.deployment.published_checkpoints import load_published, save_published
from deux.environment.egocentric import Crops
from deux.errors import DeuxError
from deux.policies.policy_files import load_policy, save_policy
from deux.policies.training_state import TrainingState, load_training_state, save_training_state
from deux.registry import registry
from deux.testing.learned_explorers import untrained_policy
from deux.training.checkpointing import resume_point

SMALL = {"image_filters": [2] * 5, "depth_filters": [2] * 5, "decoder_filters": [2] * 5}
LARGE = (10**5, 10**9, [10**5] * 5, [10**9] * 5, [2] * 100_000, [0] * 5, [-1] * 5, [2.5] * 5, "22222")


@pytest.fixture(scope="module")
def kbnet():
    """A depth model of a few kilobytes."""
    torch.manual_seed(0)
    return registry().create("depth_models", "kbnet", SMALL)


@pytest.fixture
def model_file(campaign, kbnet):
    """Its file."""
    path = campaign.folder / "model.safetensors"
    save_model(path, kbnet, "kbnet", SMALL)
    return path


def with_metadata(weights: dict, metadata: dict) -> bytes:
    return safetensors.torch.save({key: tensor.contiguous() for key, tensor in weights.items()}, metadata)


def test_metadata_of_model_files(campaign, kbnet, model_file):
    weights = kbnet.state_dict()
    with safetensors.safe_open(model_file, "pt") as file:
        config = json.loads(file.metadata()[METADATA_KEY])
    cases = [*changed_values(config, VALUES), *changed_values(config["settings"], LARGE), *NO_JSON]
    wrapped = [
        Case(case.name, with_metadata(weights, {METADATA_KEY: case.content.decode(errors="replace")})) for case in cases
    ]
    larger = [
        Case(
            f"settings of {case.name}",
            with_metadata(weights, {METADATA_KEY: json.dumps({**config, "settings": json.loads(case.content)})}),
        )
        for case in changed_values(config["settings"], LARGE)
    ]
    campaign.run([*larger, *wrapped], model_file, lambda: load_model(model_file))
    campaign.end()


def test_headers_of_model_files(campaign, model_file):
    content = model_file.read_bytes()
    length = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + length])
    few = dict(list(header.items())[:4])

    def file(text: bytes, size: int | None = None) -> bytes:
        return struct.pack("<Q", len(text) if size is None else size) + text + content[8 + length :]

    cases = [
        Case(case.name, file(json.dumps(header | json.loads(case.content)).encode()))
        for case in changed_values(few)
        if isinstance(json.loads(case.content), dict)
    ]
    cases += [Case(f"header {case.name}", file(case.content)) for case in NO_JSON]
    cases += [Case(f"length {size}", file(b"{}", size)) for size in (0, 2**31, 2**63, 2**64 - 1)]
    campaign.run([*cases, *damaged_bytes(content, 60)], model_file, lambda: load_model(model_file))
    campaign.end()


@pytest.mark.parametrize("change", [float("nan"), float("inf"), torch.int64, torch.bool, torch.complex64])
def test_weights_that_are_no_numbers_or_of_another_type(campaign, kbnet, model_file, change):
    """They are refused by the name of the tensor, in files of deux and in published ones."""

    def changed(weights: dict) -> tuple[str, dict]:
        name = next(iter(weights))
        tensor = weights[name].clone()
        if isinstance(change, torch.dtype):
            tensor = tensor.to(change)
        else:
            tensor.view(-1)[0] = change
        return name, {**weights, name: tensor}

    problem = "of another type" if isinstance(change, torch.dtype) else "with NaN or infinity"
    with safetensors.safe_open(model_file, "pt") as file:
        metadata = file.metadata()
    name, weights = changed({key: tensor.contiguous() for key, tensor in kbnet.state_dict().items()})
    try:
        content = with_metadata(weights, metadata)
    except KeyError:  # before 0.7
        pytest.skip(f"this safetensors writes no {change}")
    model_file.write_bytes(content)
    with pytest.raises(DeuxError, match=rf"model\.safetensors .* has 1 tensor {problem} \({re.escape(name)}"):
        load_model(model_file)

    path = campaign.folder / "model.pth"
    save_published(kbnet, "kbnet", path)
    content = torch.load(path, weights_only=True)
    group = next(group for group, value in content.items() if isinstance(value, dict))
    name, content[group] = changed(content[group])
    torch.save(content, path)
    name = re.escape(name.removeprefix("module."))
    with pytest.raises(DeuxError, match=rf"model\.pth .* {group} has 1 tensor {problem} \({name}"):
        load_published("kbnet", path, settings=SMALL)


class Touch:
    """Unpickled, it leaves a file behind."""

    def __reduce__(self):
        return os.system, ("touch marker",)


def saved(content) -> bytes:
    file = io.BytesIO()
    torch.save(content, file)
    return file.getvalue()


OTHERS = (None, 3, "text", [], {}, [1, 2], {"a": 1}, torch.zeros(3), {"state_dict": {}}, {"state_dict": None})


def hostile_checkpoints(good: dict) -> list[Case]:
    """Checkpoints in which each value at the top is another, and what is no checkpoint."""
    cases = [Case(f"all is {str(other)[:20]}", saved(other)) for other in OTHERS]
    for key in good:
        cases += [Case(f"{key} is {str(other)[:20]}", saved({**good, key: other})) for other in OTHERS]
        cases.append(Case(f"no {key}", saved({k: v for k, v in good.items() if k != key})))
    cases += damaged_bytes(saved(good), 40)
    for protocol in (0, 2, 4):
        cases.append(Case(f"pickle {protocol}", pickle.dumps(Touch(), protocol)))
    return [*cases, Case("pickle in a checkpoint", saved({"a": Touch()})), *NO_JSON]


def test_published_checkpoints(campaign, kbnet, monkeypatch):
    monkeypatch.chdir(campaign.folder)
    path = campaign.folder / "model.pth"
    save_published(kbnet, "kbnet", path)
    good = torch.load(path, weights_only=True)
    campaign.run(hostile_checkpoints(good), path, lambda: load_published("kbnet", path, settings=SMALL))
    campaign.end()


def test_states_of_a_policy_training(campaign, monkeypatch):
    monkeypatch.chdir(campaign.folder)
    path = campaign.folder / "checkpoint.pt"
    rewards = [{"bias": np.zeros(2, np.float32)}]
    state = TrainingState(
        {"a": torch.zeros(2)}, {"state": {}, "param_groups": []}, 10, (0.0, 1.0, 2.0), rewards, ([1], [2.0], [3.0])
    )
    save_training_state(path, state)
    good = torch.load(path, weights_only=True)
    campaign.run(hostile_checkpoints(good), path, lambda: load_training_state(path))
    campaign.end()


def test_checkpoints_of_a_training(campaign, monkeypatch):
    monkeypatch.chdir(campaign.folder)
    path = campaign.folder / "a.ckpt"
    good = {"epoch": 0, "global_step": 1, "state_dict": {"a": torch.zeros(2)}, "loops": {}, "optimizer_states": []}
    with pytest.warns(UserWarning, match="passed over"):
        campaign.run(hostile_checkpoints(good), path, lambda: resume_point(campaign.folder))
    campaign.end()


def test_policy_files(campaign):
    path = campaign.folder / "policy.safetensors"
    save_policy(path, untrained_policy(Crops(near=3.0, far=9.0, pixels=16)))
    content = path.read_bytes()
    length = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + length])
    own = json.loads(header["__metadata__"]["deux_policy"])

    def with_header(case: Case) -> Case:
        changed = json.dumps(
            {**header, "__metadata__": {"deux_policy": case.content.decode(errors="replace")}}
        ).encode()
        return Case(case.name, struct.pack("<Q", len(changed)) + changed + content[8 + length :])

    cases = [
        with_header(case) for case in (*changed_values(own), *changed_values(own["crops"], (10**5, 10**9)), *NO_JSON)
    ]
    campaign.run([*cases, *damaged_bytes(content, 60)], path, lambda: load_policy(path))
    campaign.end()


def test_no_files(campaign, special_files):
    for path in special_files(".safetensors", ".pth"):
        campaign.call(path.name[:20], lambda path=path: load_model(path))
        campaign.call(path.name[:20], lambda path=path: load_published("kbnet", path))
        campaign.call(path.name[:20], lambda path=path: load_policy(path))
    campaign.end()
