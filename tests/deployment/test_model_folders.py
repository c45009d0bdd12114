import copy
import json
import pickle
from types import SimpleNamespace

import pytest
import safetensors.torch
import torch
import yaml
from torch import nn

import deux
from deux.contracts import DepthModel, Prediction
from deux.deployment import model_folders
from deux.deployment.model_files import MODEL_FILE, load_model, save_model
from deux.deployment.model_folders import CARD_FILE, CONFIG_FILE, from_pretrained
from deux.errors import DeuxError
from deux.registry import registry

SMALL = {"image_filters": [4, 8, 8, 8, 8], "depth_filters": [4] * 5, "decoder_filters": [8, 8, 8, 8, 4]}


@pytest.fixture
def kbnet(tmp_path) -> DepthModel:
    """A small KBNet with random weights, as it is loaded from a file."""
    model = registry().create("depth_models", "kbnet", SMALL)
    save_model(tmp_path / "kbnet.safetensors", model, "kbnet", SMALL)
    return deux.load(tmp_path / "kbnet.safetensors")


@pytest.fixture
def folder(kbnet, tmp_path):
    """A folder that such a model was saved to."""
    return kbnet.save_pretrained(tmp_path / "shared" / "kbnet")


class Greedy(DepthModel):
    """Notes the elements that it asks memory for."""

    min_depth, max_depth = 0.1, 10.0
    memory = 0

    def __init__(self, width: int = 2) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.ones(width))
        type(self).memory = max(self.memory, 0 if self.scale.is_meta else width)

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(sparse_depth + self.scale[0])


@pytest.fixture
def greedy():
    registry().register("depth_models", "greedy", Greedy)
    yield
    registry().unregister("depth_models", "greedy")


def edit(folder, **changes) -> None:
    """Change entries of config.json."""
    file = folder / CONFIG_FILE
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


def anonymous(folder) -> None:
    """Take the header out of the weights, as other programs write none."""
    file = folder / MODEL_FILE
    safetensors.torch.save_file(safetensors.torch.load_file(file), file)


def test_a_folder_gives_the_model_back_bit_for_bit(kbnet, folder):
    assert sorted(path.name for path in folder.iterdir()) == [CARD_FILE, CONFIG_FILE, MODEL_FILE]
    for read in (from_pretrained, load_model, deux.load):
        model = read(folder)
        assert type(model) is type(kbnet)
        assert not model.training
        assert model.state_dict().keys() == kbnet.state_dict().keys()
        assert all(torch.equal(value, kbnet.state_dict()[key]) for key, value in model.state_dict().items())


def test_config_json_lists_what_the_model_is_made_of(folder):
    config = json.loads((folder / CONFIG_FILE).read_text())
    assert config["name"] == "kbnet"
    assert config["settings"] == {**config["settings"], **SMALL}
    assert "max_depth" in config["settings"]
    assert config["version"] == deux.__version__


def test_the_card_begins_with_what_the_hub_reads(kbnet, tmp_path):
    folder = kbnet.save_pretrained(tmp_path / "other", licence="cc-by-4.0")
    _, header, page = (folder / CARD_FILE).read_text().split("---\n", 2)
    assert yaml.safe_load(header) == {
        "license": "cc-by-4.0",
        "library_name": "deux",
        "pipeline_tag": "depth-estimation",
        "tags": ["depth-completion", "kbnet"],
    }
    assert "# other" in page
    assert "deux.from_pretrained(" in page


def test_a_card_that_is_there_is_kept_and_the_model_replaced(folder, tmp_path):
    (folder / CARD_FILE).write_text("mine")
    model = from_pretrained(folder)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(1.0)
    model.save_pretrained(folder)
    assert (folder / CARD_FILE).read_text() == "mine"
    again = from_pretrained(folder)
    assert all(torch.equal(a, b) for a, b in zip(again.parameters(), model.parameters(), strict=True))


def test_weights_without_a_header_are_described_by_config_json(kbnet, folder):
    anonymous(folder)
    model = from_pretrained(folder)
    assert all(torch.equal(a, b) for a, b in zip(model.parameters(), kbnet.parameters(), strict=True))
    with pytest.raises(DeuxError, match="has no configuration of a model"):
        deux.load(folder)


def test_other_names_are_those_that_load_knows(kbnet, tmp_path):
    model = from_pretrained(tmp_path / "kbnet.safetensors")
    assert model.save_pretrained(tmp_path / "again") == tmp_path / "again"
    with pytest.raises(DeuxError, match="there is no model nowhere"):
        from_pretrained("nowhere")


def test_a_missing_folder_is_reported_without_asking_the_hub(tmp_path, monkeypatch):
    asked = []
    hub = SimpleNamespace(download=lambda name, **options: asked.append(name))
    monkeypatch.setattr(model_folders, "_hub", lambda purpose: hub)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    for path in ("./owner/kbnet", "../kbnet", "~/kbnet", "a/b/kbnet", str(tmp_path / "kbnet"), "runs/kbnet"):
        with pytest.raises(DeuxError, match="there is no model"):
            from_pretrained(path)
    assert asked == []
    from_pretrained("owner/kbnet")
    from_pretrained("runs/kbnet", revision="main")
    assert asked == ["owner/kbnet", "runs/kbnet"]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))])
def test_a_copy_saves_itself(kbnet, tmp_path, copied):
    model = copied(kbnet)
    with torch.no_grad():
        next(model.parameters()).fill_(7.0)
    saved = from_pretrained(model.save_pretrained(tmp_path / "copy"))
    assert (next(saved.parameters()) == 7.0).all()
    assert not (next(kbnet.parameters()) == 7.0).all()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"name": "kbnt"}, "there is no depth model called 'kbnt': did you mean kbnet"),
        ({"name": ["kbnet"]}, "name must be text"),
        ({"settings": [1]}, "settings must be names"),
        ({"settings": {"command": "rm"}}, "command is not an option of KBNet"),
        ({"settings": {"image_filters": "os.system"}}, "image_filters must be a list"),
        (
            {"settings": {"image_filters": [-1, 8, 8, 8, 8]}},
            "cannot be created here: model.image_filters is -1: it must be at least 1",
        ),
        ({"settings": {"max_depth": float("nan")}}, "max_depth=nan must satisfy 0 < min_depth"),
        ({"auto_map": {"AutoModel": "code.Model"}}, "auto_map is not an option"),
    ],
)
def test_a_hostile_config_is_refused(folder, changes, sentence):
    anonymous(folder)
    edit(folder, **changes)
    with pytest.raises(DeuxError, match=sentence):
        from_pretrained(folder)


@pytest.mark.parametrize("content", ["", "{", "[]", "[" * 100_000, "null", b"\xff\xfe\x00"])
def test_a_config_that_is_no_configuration_is_refused(folder, content):
    (folder / CONFIG_FILE).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(DeuxError, match=r"config.json is damaged"):
        from_pretrained(folder)


@pytest.mark.usefixtures("greedy")
def test_settings_get_no_memory_before_the_weights_were_compared(tmp_path):
    save_model(tmp_path / MODEL_FILE, Greedy(), "greedy", {})
    (tmp_path / CONFIG_FILE).write_text(
        json.dumps({"name": "greedy", "settings": {"width": 10**13}, "version": deux.__version__})
    )
    anonymous(tmp_path)
    Greedy.memory = 0
    with pytest.raises(DeuxError, match="has 1 tensor of another shape"):
        from_pretrained(tmp_path)
    assert Greedy.memory == 0


def test_files_of_two_models_are_refused(folder):
    edit(folder, settings={**SMALL, "max_depth": 3.0})
    with pytest.raises(DeuxError, match="name different models or settings"):
        from_pretrained(folder)


def test_weights_are_never_unpickled(folder):
    (folder / MODEL_FILE).write_bytes(pickle.dumps({"weight": 1}))
    with pytest.raises(DeuxError, match="cannot be read as safetensors"):
        from_pretrained(folder)
    (folder / MODEL_FILE).rename(folder / "pytorch_model.bin")
    with pytest.raises(DeuxError, match=f"has a {CONFIG_FILE} and no {MODEL_FILE}"):
        from_pretrained(folder)


def test_a_name_of_the_hub_needs_its_package(kbnet, tmp_path, monkeypatch):
    monkeypatch.setattr(model_folders, "find_spec", lambda name: None)
    with pytest.raises(DeuxError, match=r'there is no folder owner/kbnet, .* pip install "deux\[hub\]"'):
        from_pretrained("owner/kbnet")
    with pytest.raises(DeuxError, match=r'pip install "deux\[hub\]"'):
        kbnet.save_pretrained(tmp_path / "shared", push_to_hub=True)
    assert kbnet.save_pretrained(tmp_path / "shared").is_dir()


def test_a_folder_that_cannot_be_made_is_reported(kbnet, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DeuxError, match="cannot be created"):
        kbnet.save_pretrained(tmp_path / "file")
