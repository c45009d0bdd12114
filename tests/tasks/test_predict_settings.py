"""The section `predict`: what its values may be, and what they mean."""

from typing import Any

import pytest

from deux.configuration import compose
from deux.errors import DeuxError
from deux.options import construct
from deux.tasks.predict_settings import PredictSettings


@pytest.fixture(scope="module")
def section() -> dict[str, Any]:
    """The section as the shipped configuration has it."""
    return dict(compose(["task=predict"]).predict)


def test_the_configuration_has_the_defaults_of_the_class(section: dict[str, Any]) -> None:
    from_yaml = construct(PredictSettings, section, "predict")
    required = {name: getattr(from_yaml, name) for name in ("checkpoint", "image", "sparse", "sparse_scale")}
    required |= {name: getattr(from_yaml, name) for name in ("intrinsics", "ground_truth", "ground_truth_scale")}
    assert from_yaml == PredictSettings(**required)
    assert section.keys() == PredictSettings.__dataclass_fields__.keys()


@pytest.mark.parametrize(
    ("export", "formats"), [(None, ()), ("glb", ("glb",)), (["glb", "ply", "glb"], ("ply", "glb")), ([], ())]
)
def test_formats_of_clouds(section: dict[str, Any], export: Any, formats: tuple[str, ...]) -> None:
    assert construct(PredictSettings, section | {"export": export}, "predict").cloud_formats == formats


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"split": "tset"}, "predict.split cannot be 'tset': did you mean test"),
        ({"keep": 0.5}, "predict.keep filters points by their confidence: choose a measure with predict.uncertainty="),
        ({"keep": 1.5, "uncertainty": "l1"}, "predict.keep is 1.5: it must be at least 0 and at most 1"),
        ({"least_confidence": -1.0, "uncertainty": "l1"}, "predict.least_confidence is -1.0: it must be at least 0"),
        ({"export": "obj"}, "predict.export must be 'ply' or 'glb' or a list"),
        ({"viewer": "meshlab"}, "predict.viewer must be 'rerun' or null, but is 'meshlab'"),
        ({"format": "exr"}, "predict.format cannot be 'exr'"),
        ({"voxel": -1}, "predict.voxel is -1.0: it must be at least 0"),
        ({"batch_size": 0}, "predict.batch_size is 0: it must be at least 1"),
    ],
)
def test_a_value_that_cannot_be(section: dict[str, Any], options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(DeuxError, match=sentence):
        construct(PredictSettings, section | options, "predict")


def test_a_measure_is_made_with_its_options(section: dict[str, Any]) -> None:
    assert construct(PredictSettings, section, "predict").make_measure() is None
    chosen = construct(PredictSettings, section | {"uncertainty": "flip"}, "predict").make_measure()
    assert chosen is not None
    assert not chosen.needs_sources
    wrong = construct(PredictSettings, section | {"uncertainty": "l1", "uncertainty_options": {"size": 3}}, "predict")
    with pytest.raises(DeuxError, match=r"predict\.uncertainty_options\.size is not an option of L1Residual"):
        wrong.make_measure()
