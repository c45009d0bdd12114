"""The hub's own package reads and writes the same folders. No test reaches the hub."""

import json
from types import SimpleNamespace

import pytest
import torch

import deux
from deux.deployment.model_files import MODEL_FILE, save_model
from deux.deployment.model_folders import CARD_FILE, CONFIG_FILE
from deux.errors import DeuxError
from deux.registry import registry

hub = pytest.importorskip("huggingface_hub", reason='the hub\'s package is not installed: pip install "deux[hub]"')
SMALL = {"image_filters": [4, 8, 8, 8, 8], "depth_filters": [4] * 5, "decoder_filters": [8, 8, 8, 8, 4]}
COMMIT = "0" * 40


@pytest.fixture
def kbnet(tmp_path):
    model = registry().create("depth_models", "kbnet", SMALL)
    save_model(tmp_path / "kbnet.safetensors", model, "kbnet", SMALL)
    return deux.load(tmp_path / "kbnet.safetensors")


@pytest.fixture
def uploads(monkeypatch) -> list[dict]:
    """What would have been uploaded: for each time the repository and the content of its files."""
    found: list[dict] = []

    def upload_folder(self, *, repo_id, folder_path, **options):
        found.append({"id": repo_id, "files": {path.name: path.read_bytes() for path in folder_path.iterdir()}})

    monkeypatch.setattr(hub.HfApi, "create_repo", lambda self, repo_id, **options: SimpleNamespace(repo_id=repo_id))
    monkeypatch.setattr(hub.HfApi, "upload_folder", upload_folder)
    return found


def cached(model, cache) -> None:
    """Lay the model into a cache of the hub, as a download leaves it there."""
    repository = cache / "models--owner--kbnet"
    model.save_pretrained(repository / "snapshots" / COMMIT)
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text(COMMIT)


def test_a_model_of_the_hub_is_read_from_its_cache(kbnet, tmp_path):
    cached(kbnet, tmp_path / "cache")
    model = deux.from_pretrained("owner/kbnet", cache_dir=tmp_path / "cache", local_files_only=True)
    assert all(torch.equal(a, b) for a, b in zip(model.parameters(), kbnet.parameters(), strict=True))
    assert (model.save_pretrained(tmp_path / "again") / CONFIG_FILE).is_file()


def test_a_hostile_config_of_the_hub_is_refused(kbnet, tmp_path):
    cached(kbnet, tmp_path / "cache")
    file = tmp_path / "cache" / "models--owner--kbnet" / "snapshots" / COMMIT / CONFIG_FILE
    options = {"cache_dir": tmp_path / "cache", "local_files_only": True}
    for content in ("[]", "{", json.dumps({"model": "kbnet", "licence": "mit"})):
        file.write_text(content)
        with pytest.raises(DeuxError, match=r"owner/kbnet, and no model of deux|has no configuration of a model"):
            deux.from_pretrained("owner/kbnet", **options)


def test_a_model_that_cannot_be_had_is_one_sentence(tmp_path):
    with pytest.raises(DeuxError) as error:
        deux.from_pretrained("owner/kbnet", cache_dir=tmp_path, local_files_only=True)
    assert str(error.value).startswith("there is no folder owner/kbnet, and no model of deux could be downloaded")
    assert "\n" not in str(error.value)


def test_what_is_uploaded_is_the_folder(kbnet, tmp_path, uploads):
    folder = tmp_path / "shared"
    kbnet.save_pretrained(folder, licence="cc0-1.0", push_to_hub=True, repo_id="owner/kbnet")
    (sent,) = uploads
    written = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert sent["id"] == "owner/kbnet"
    assert sent["files"].keys() == written.keys() == {CARD_FILE, CONFIG_FILE, MODEL_FILE}
    assert all(sent["files"][name] == written[name] for name in (CONFIG_FILE, MODEL_FILE))
    assert b'license: "cc0-1.0"' in sent["files"][CARD_FILE]
    assert hub.ModelCard(sent["files"][CARD_FILE].decode()).data.to_dict()["library_name"] == "deux"


def test_a_card_that_is_there_is_uploaded(kbnet, tmp_path, uploads):
    folder = kbnet.save_pretrained(tmp_path / "shared")
    (folder / CARD_FILE).write_text("mine")
    kbnet.save_pretrained(folder, push_to_hub=True, repo_id="owner/kbnet")
    assert uploads[0]["files"][CARD_FILE] == b"mine" == (folder / CARD_FILE).read_bytes()


def test_the_mixin_saves_the_same_files(kbnet, tmp_path):
    plain = kbnet.save_pretrained(tmp_path / "plain" / "kbnet")
    mixin = kbnet.save_pretrained(tmp_path / "mixin" / "kbnet", push_to_hub=False)
    assert {p.name: p.read_bytes() for p in plain.iterdir()} == {p.name: p.read_bytes() for p in mixin.iterdir()}


def test_an_upload_that_fails_is_one_sentence(kbnet, tmp_path, monkeypatch):
    def refuse(self, repo_id, **options):
        raise OSError("the network is down\nand more")

    monkeypatch.setattr(hub.HfApi, "create_repo", refuse)
    with pytest.raises(DeuxError, match=r"was not uploaded to .* hub \(OSError: the network is down\)\.$"):
        kbnet.save_pretrained(tmp_path / "shared", push_to_hub=True, repo_id="owner/kbnet")
