"""Every published architecture against its recorded case: checkpoint in, depth and poses out."""

import pytest
import torch

import deux
from deux.registry import registry

PARAMETERS = {
    "kbnet": (6_957_764, 4_063_104),
    "voiced": (10_041_200, 1_587_776),
    "scaffnet": (2_870_960, None),
    "fusionnet": (6_751_088 + 2_870_960, 1_587_776),
}
"""Of the model and of its pose network."""

POSES = {"pose01": ("image0", "image1"), "pose02": ("image0", "image2"), "pose10": ("image1", "image0")}
"""The images between which each recorded pose moves points; VOICED records the way back, too."""


@pytest.mark.parametrize("name", PARAMETERS)
def test_number_of_parameters(name):
    model = registry().create("depth_models", name, {})
    pose = model.pose_network()
    counts = [None if module is None else sum(p.numel() for p in module.parameters()) for module in (model, pose)]
    assert tuple(counts) == PARAMETERS[name]


@pytest.mark.parametrize("prefix", ["module.", ""])
@pytest.mark.parametrize("name", PARAMETERS)
def test_published_checkpoint_gives_the_published_depth(published_case, tmp_path, name, prefix):
    case = published_case(name)
    torch.save(case.checkpoint(prefix=prefix), tmp_path / "published.pth")
    model = deux.load_published(name, tmp_path / "published.pth")
    inputs = case.arrays
    depth = model.predict(inputs["image0"], inputs["sparse_depth"], inputs["intrinsics"])
    torch.testing.assert_close(depth, inputs["output_depth"], rtol=1e-4, atol=0.0)


@pytest.mark.parametrize("prefix", ["module.", ""])
@pytest.mark.parametrize("name", [name for name, (_, pose) in PARAMETERS.items() if pose])
def test_published_pose_checkpoint_gives_the_published_poses(published_case, tmp_path, name, prefix):
    case = published_case(name)
    torch.save(case.checkpoint(prefix=prefix), tmp_path / "published.pth")
    torch.save(case.checkpoint(pose=True, prefix=prefix), tmp_path / "pose.pth")
    network = deux.load_published(name, tmp_path / "published.pth", tmp_path / "pose.pth").pose_network()
    recorded = [name for name in POSES if name in case.arrays]
    assert {"pose01", "pose02"} <= set(recorded)
    for pose in recorded:
        target, source = (case.arrays[image] for image in POSES[pose])
        with torch.no_grad():
            torch.testing.assert_close(network(target, source), case.arrays[pose], rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("name", PARAMETERS)
def test_the_file_of_another_model_is_refused_by_its_keys(published_case, tmp_path, name):
    other = "kbnet" if name != "kbnet" else "voiced"
    torch.save(published_case(other).checkpoint(), tmp_path / "published.pth")
    with pytest.raises(deux.errors.DeuxError, match=f"of {name}: it lacks .*; it looks like a checkpoint of {other}"):
        deux.load_published(name, tmp_path / "published.pth")
