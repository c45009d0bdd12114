"""`task=export_dataset`, as a user runs it."""

import json
from pathlib import Path

import numpy as np
import pytest

from deux.io.images import read_image
from deux_plugins.readers.webdataset import Shards


@pytest.mark.parametrize(
    ("form", "reader", "folder"),
    [("void", "deux", "void_1500"), ("triplets", "triplets", ""), ("webdataset", "webdataset", "")],
)
def test_what_is_exported_is_evaluated_like_what_was_collected(
    deux, tiny_arguments, tmp_path, model_file, form, reader, folder
):
    def run(name, *options):
        outcome = deux(*tiny_arguments(tmp_path / "outputs", *options, f"hydra.run.dir={tmp_path}/{name}"))
        assert outcome.code == 0, outcome.err
        return outcome.out

    output = tmp_path / "export"
    said = run(
        "a", "task=export_dataset", "explore=random", f"export_dataset.format={form}", f"export_dataset.output={output}"
    )
    assert ("The published set-up script skips 30 files" in said) == (form == "void")
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".export")] == []
    given = (f"data={reader}", f"evaluation.data={output / folder}")
    results = []
    for name, options in (("b", given), ("c", ())):
        run(name, "task=evaluate", f"evaluation.checkpoint={model_file('kbnet')}", *options)
        results.append(json.loads((tmp_path / name / "results.json").read_text()))
    for errors in ("metrics", "baseline"):
        assert results[0][errors] == pytest.approx(results[1][errors], rel=1e-5)


def test_training_frames_take_the_source_frames_that_are_asked_for(deux, tiny_arguments, tmp_path):
    found = {}
    for sources in ("recent", "baseline"):
        output = tmp_path / sources
        options = (f"export_dataset.sources={sources}", f"export_dataset.output={output}")
        arguments = ("task=export_dataset", "explore=random", "export_dataset.format=webdataset", *options)
        outcome = deux(*tiny_arguments(tmp_path / "outputs", *arguments, f"hydra.run.dir={tmp_path}/{sources}-run"))
        assert outcome.code == 0, outcome.err
        (dataset,) = tmp_path.glob("outputs/datasets/random-*")
        kind = "triplets" if sources == "recent" else "triplets_baseline"
        lines = [line.split("\t") for line in (dataset / f"train_{kind}.txt").read_text().splitlines()]
        listed = {Path(target).stem: images for target, *images in lines}
        reader = Shards(output)
        found[sources] = dict(reader.triplets("train", ()))
        assert {target.name for target in found[sources]} == set(listed)
        for target, shards in found[sources].items():
            for frame, image in zip(shards, listed[target.name], strict=True):
                np.testing.assert_array_equal(reader.image(frame), read_image(dataset.parent / image))
    assert set(found["baseline"]) != set(found["recent"])


def test_one_split_of_a_folder(deux, tiny_arguments, tmp_path):
    output, again = tmp_path / "export", tmp_path / "again"
    options = ("task=export_dataset", "explore=random", "export_dataset.format=webdataset")
    given = ("data=webdataset", f"export_dataset.test={output}")
    for folder, further in ((output, ()), (again, given)):
        arguments = (
            *options,
            f"export_dataset.output={folder}",
            *further,
            f"hydra.run.dir={tmp_path}/{folder.name}-run",
        )
        outcome = deux(*tiny_arguments(tmp_path / "outputs", *arguments))
        assert outcome.code == 0, outcome.err
    assert [path.name for path in again.iterdir()] == ["test-000000.tar"]
    assert (again / "test-000000.tar").read_bytes() == (output / "test-000000.tar").read_bytes()
    assert "This export is complete" in deux(*tiny_arguments(tmp_path / "outputs", *arguments)).out
    (output / "test-000000.tar").touch()
    assert "already exists: remove it" in deux(*tiny_arguments(tmp_path / "outputs", *arguments)).sentence


def test_the_command_that_has_made_the_folder_finds_it_and_no_other_command_does(deux, tiny_arguments, tmp_path):
    """As a kill between the folder's renaming and the command's end leaves it."""
    output, run = tmp_path / "export", f"hydra.run.dir={tmp_path}/run"
    options = ("task=export_dataset", "explore=random", "export_dataset.format=webdataset", run)

    def export(*further):
        return deux(*tiny_arguments(tmp_path / "outputs", *options, f"export_dataset.output={output}", *further))

    assert export().code == 0
    before = {path: path.stat().st_mtime_ns for path in output.iterdir()}
    again = export()
    assert (again.code, again.out.strip()) == (0, f"This export is complete: {output}")
    assert before == {path: path.stat().st_mtime_ns for path in output.iterdir()}
    assert "already exists" in export("export_dataset.samples=7").sentence
    output.rename(tmp_path / "elsewhere")
    output.mkdir()
    assert "already exists" in export().sentence


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        ("export_dataset.output=null", "task=export_dataset needs an output folder: set export_dataset.output=."),
        ("export_dataset.output={there}", "export_dataset.output={there} already exists: remove it or choose another"),
        (
            "export_dataset.format=kitti",
            "export_dataset.format cannot be 'kitti': there is: triplets, void, webdataset.",
        ),
    ],
)
def test_an_option_that_cannot_be(deux, tmp_path, option, sentence):
    outcome = deux("task=export_dataset", option.format(there=tmp_path), f"hydra.run.dir={tmp_path}/run")
    assert outcome.sentence.startswith(sentence.format(there=tmp_path))
