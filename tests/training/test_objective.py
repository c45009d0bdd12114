import re
from typing import ClassVar

import numpy as np
import pytest
import torch
from torch import nn

from deux.contracts import Batch, DepthModel, LossInputs, LossNeed, LossSettings, LossTerm, Prediction
from deux.errors import DeuxError
from deux.registry import registry
from deux.testing.host_waits import refuse_host_waits
from deux.testing.losses import DEPTH_RANGE, imperfect_sample
from deux.training import objective as objective_module
from deux.training.objective import Objective, make_objective, merge_settings
from deux.training.pose_source import RelativePoses

KBNET_STRUCTURE = {"halved": True, "channels": "sum", "window": "box", "border": "stretch", "pixels": "all"}


class Model(DepthModel):
    objective: ClassVar[LossSettings] = {
        "color_consistency": {"weight": 0.15, "pixels": "all"},
        "structural_consistency": {"weight": 0.95, **KBNET_STRUCTURE},
        "sparse_depth": 2.0,
        "local_smoothness": 2.0,
    }
    min_depth, max_depth = DEPTH_RANGE

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared) -> Prediction:
        return Prediction(sparse_depth)


class Probe(LossTerm):
    """Records what it is given; its value is the mean depth."""

    def __init__(self, *needs: LossNeed, extras: tuple[str, ...] = ()) -> None:
        self.needs, self.extras = frozenset(needs), frozenset(extras)

    def __call__(self, inputs: LossInputs) -> torch.Tensor:
        self.inputs = inputs
        return inputs.prediction.depth.mean()


def objective_of(*terms: LossTerm, **arguments) -> Objective:
    """Terms of weight 1, named a, b and so on."""
    return Objective({name: (1.0, term) for name, term in zip("abc", terms, strict=False)}, DEPTH_RANGE, **arguments)


def test_total_and_terms_of_the_published_case(shared_data):
    case = {key: torch.from_numpy(value) for key, value in np.load(shared_data("cases") / "kbnet.npz").items()}
    batch = Batch(
        image=case["image0"],
        sources=torch.stack([case["image1"], case["image2"]], dim=1),
        sparse_depth=case["sparse_depth"],
        validity=case["filtered_validity_map"],
        input_sparse_depth=case["sparse_depth"],
        intrinsics=case["intrinsics"],
        source_from_target=torch.stack([case["pose01"], case["pose02"]], dim=1),
    )
    losses = make_objective(Model())(batch, Prediction(case["output_depth"]))
    published = {
        "color_consistency": "loss_color",
        "structural_consistency": "loss_structure",
        "sparse_depth": "loss_sparse_depth",
        "local_smoothness": "loss_smoothness",
    }
    for name, key in published.items():
        assert float(losses.terms[name]) == pytest.approx(float(case[key]), rel=1e-4)
    assert float(losses.total) == pytest.approx(float(case["loss_total"]), rel=1e-4)


def test_configuration_is_laid_over_the_published_settings():
    published = {"a": 0.5, "b": {"weight": 1.0, "pixels": "all"}, "c": 2.0, "d": 3.0}
    overrides = {"b": 0.25, "c": None, "d": 0, "a": {"halved": True}, "e": {"weight": 4, "window": "box"}}
    assert merge_settings(published, overrides) == {
        "a": {"weight": 0.5, "halved": True},
        "b": {"weight": 0.25, "pixels": "all"},
        "e": {"weight": 4, "window": "box"},
    }


@pytest.mark.parametrize("setting", ["heavy", -1.0, float("nan"), True, {"weight": "1"}])
def test_a_weight_is_a_number_of_zero_or_more(setting):
    with pytest.raises(DeuxError, match=r"objective\.sparse_depth has the weight"):
        merge_settings({}, {"sparse_depth": setting})


def test_a_new_term_needs_a_weight():
    with pytest.raises(DeuxError, match=r"set objective\.sparse_depth\.weight"):
        merge_settings({}, {"sparse_depth": {"threshold": 1.0}})


def test_unknown_terms_and_options_are_named():
    with pytest.raises(DeuxError, match="did you mean sparse_depth"):
        make_objective(Model(), {"sparse_dept": 1.0})
    with pytest.raises(DeuxError, match=r"objective\.color_consistency\.chanels"):
        make_objective(Model(), {"color_consistency": {"chanels": "sum"}})


def test_no_term_is_left():
    with pytest.raises(DeuxError, match="no terms"):
        make_objective(Model(), dict.fromkeys(Model.objective))


def test_weights_apply_to_the_total_and_not_to_the_terms():
    sample = imperfect_sample()
    losses = Objective({"a": (0.5, Probe()), "b": (3.0, Probe())}, DEPTH_RANGE)(sample.batch, Prediction(sample.depth))
    torch.testing.assert_close(losses.terms["a"], sample.depth.mean())
    torch.testing.assert_close(losses.total, 3.5 * sample.depth.mean())


def test_reconstructions_are_made_once_and_only_if_needed(monkeypatch):
    calls = []
    original = objective_module.reproject
    monkeypatch.setattr(objective_module, "reproject", lambda *args: calls.append(args) or original(*args))
    sample = imperfect_sample()
    first, second = Probe(LossNeed.RECONSTRUCTIONS), Probe(LossNeed.RECONSTRUCTIONS)
    objective_of(first, second)(sample.batch, Prediction(sample.depth))
    assert len(calls) == 1
    assert first.inputs is second.inputs
    assert first.inputs.reconstructions is not None
    losses = objective_of(Probe())(sample.batch, Prediction(sample.depth))
    assert len(calls) == 1
    assert losses.reconstructions is None


def test_given_poses_are_used():
    sample, term = imperfect_sample(), Probe(LossNeed.RECONSTRUCTIONS, LossNeed.BACKWARD_POSES)
    objective = objective_of(term)
    assert objective.needs_backward_poses
    poses = RelativePoses(torch.eye(4).repeat(2, 2, 1, 1), sample.target_from_source)
    objective(sample.batch, Prediction(sample.depth), poses)
    torch.testing.assert_close(term.inputs.reconstructions.images, sample.batch.sources, atol=1e-4, rtol=0)
    assert term.inputs.reconstructions.target_from_source is sample.target_from_source


def test_an_unsupervised_objective_cannot_read_ground_truth():
    sample, term = imperfect_sample(), Probe()
    clean = make_objective(Model())(sample.batch, Prediction(sample.depth))
    sample.batch.ground_truth = torch.full_like(sample.depth, torch.nan)
    poisoned = make_objective(Model())(sample.batch, Prediction(sample.depth))
    assert torch.equal(clean.total, poisoned.total)
    objective_of(term)(sample.batch, Prediction(sample.depth))
    assert term.inputs.batch.ground_truth is None
    with pytest.raises(DeuxError, match="the model is unsupervised"):
        objective_of(Probe(LossNeed.GROUND_TRUTH))


def test_no_installed_term_that_reads_ground_truth_fits_an_unsupervised_model():
    """Neither by configuration nor by the model's own objective."""
    terms = {name: registry().create("losses", name, {}) for name in registry().names("losses")}
    reading = [name for name, term in terms.items() if LossNeed.GROUND_TRUTH in term.needs]
    assert "supervised_depth" in reading
    for name in reading:
        own = type("Own", (Model,), {"objective": {name: 1.0}})()
        for model, overrides in (
            (Model(), {name: 1e-9}),
            (Model(), {name: {"weight": 1.0}, **dict.fromkeys(Model.objective)}),
            (own, None),
        ):
            with pytest.raises(
                DeuxError, match=rf"objective\.{name} reads ground truth, but the model is unsupervised"
            ):
                make_objective(model, overrides)


def test_a_term_that_declares_its_need_too_late_gets_no_ground_truth():
    sample, term = imperfect_sample(), Probe()
    objective = objective_of(term)
    term.needs = frozenset({LossNeed.GROUND_TRUTH})
    objective(sample.batch, Prediction(sample.depth))
    assert term.inputs.batch.ground_truth is None


def test_a_supervised_objective_gets_ground_truth_and_reports_when_there_is_none():
    sample, term = imperfect_sample(), Probe(LossNeed.GROUND_TRUTH)
    objective = objective_of(term, supervised=True)
    objective(sample.batch, Prediction(sample.depth))
    assert term.inputs.batch.ground_truth is sample.batch.ground_truth
    sample.batch.ground_truth = None
    with pytest.raises(DeuxError, match="without it"):
        objective(sample.batch, Prediction(sample.depth))


def test_a_missing_extra_is_named_with_its_term_and_model():
    class Sure(LossTerm):
        extras = frozenset({"variance"})

        def __call__(self, inputs):
            return inputs.prediction.extras["variance"].mean()

    sample = imperfect_sample()
    objective = Objective({"sure": (1.0, Sure())}, DEPTH_RANGE, model="KBNet")
    sentence = r"objective\.sure needs the extra 'variance' .* KBNet does not give \(its extras: .*objective\.sure=null"
    with pytest.raises(DeuxError, match=sentence.replace("extras: ", "extras: none")):
        objective(sample.batch, Prediction(sample.depth))
    with pytest.raises(DeuxError, match=sentence.replace("extras: ", "extras: normals, prior")):
        objective(sample.batch, Prediction(sample.depth, {"prior": sample.depth, "normals": sample.depth}))
    assert objective(sample.batch, Prediction(sample.depth, {"variance": 3 * torch.ones(1)})).total == 3.0


def test_a_model_without_the_extra_of_an_installed_term_is_named():
    sample = imperfect_sample()
    objective = make_objective(Model(), {"topology_prior": 1.0})
    with pytest.raises(
        DeuxError, match=r"objective\.topology_prior needs the extra 'prior' .* which the depth model Model does not"
    ):
        objective(sample.batch, Prediction(sample.depth))


def test_an_objective_may_be_set_in_the_models_constructor():
    class Own(Model):
        def __init__(self, smoothness: float, supervised: bool) -> None:
            super().__init__()
            self.objective = {"sparse_depth": 1.0, "local_smoothness": smoothness}
            self.supervised = supervised

    assert make_objective(Own(0.25, False)).weights == {"sparse_depth": 1.0, "local_smoothness": 0.25}
    truthful = make_objective(Own(0.25, True), {"supervised_depth": 1.0})
    assert truthful.supervised
    with pytest.raises(DeuxError, match=r"objective\.supervised_depth reads ground truth, but the model is unsup"):
        make_objective(Own(0.25, False), {"supervised_depth": 1.0})
    with pytest.raises(
        DeuxError, match=r"^the objective of the depth model Listed is \['sparse_depth'\]: it must be a mapping, from"
    ):
        make_objective(type("Listed", (Model,), {"objective": ["sparse_depth"]})())


WRONG_PREDICTIONS = {
    "the `forward` of Model gives Tensor of 2 x 1 x 24 x 32, float32: it must be a deux.contracts.Pred": lambda depth: (
        depth
    ),
    "the `forward` of Model gives a value of the type dict: it must be a": lambda depth: {"depth": depth},
    "the `forward` of Model gives None: it must be a": lambda depth: None,
    "the `forward` of Model gives a prediction whose depth is Tensor of 2 x 24 x 32, float32: it must be a Tensor of "
    "N x 1 x H x W, float32, here 2 x 1 x 24 x 32.": lambda depth: Prediction(depth[:, 0]),
    "the `forward` of Model gives a prediction whose depth is Tensor of 2 x 1 x 12 x 16, float32: it": lambda depth: (
        Prediction(depth[..., ::2, ::2])
    ),
    "the `forward` of Model gives a prediction whose depth is ndarray of 2 x 1 x 24 x 32, float32: it": lambda depth: (
        Prediction(depth.numpy())
    ),
    "the `forward` of Model gives a prediction whose depth is Tensor of 2 x 1 x 24 x 32, int64: it": lambda depth: (
        Prediction(depth.long())
    ),
}


@pytest.mark.parametrize("told", WRONG_PREDICTIONS)
def test_the_model_is_named_for_what_is_no_prediction_of_the_batch(told):
    sample = imperfect_sample()
    objective = objective_of(Probe(LossNeed.RECONSTRUCTIONS), model="Model")
    with pytest.raises(DeuxError, match=f"^{re.escape(told)}"):
        objective(sample.batch, WRONG_PREDICTIONS[told](sample.depth))


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (lambda depth: 0.5, "a value of the type float"),
        (lambda depth: None, "None"),
        (lambda depth: depth.mean((1, 2, 3)), "Tensor of 2, float32"),
        (lambda depth: depth, "Tensor of 2 x 1 x 24 x 32, float32"),
        (lambda depth: np.float32(0.5), "float32 of a single number, float32"),
        (lambda depth: (depth > 1).any(), "Tensor of a single number, bool"),
    ],
)
def test_a_term_that_gives_no_scalar_is_named(value, told):
    class Term(LossTerm):
        def __call__(self, inputs):
            return value(inputs.prediction.depth)

    sample = imperfect_sample()
    with pytest.raises(DeuxError, match=rf"^objective\.b gives {told}: a loss term gives a Tensor without dimensions"):
        objective_of(Probe(), Term())(sample.batch, Prediction(sample.depth))


def test_wrong_values_are_reported_without_reading_them():
    """On a card, that would wait for it."""
    sample = imperfect_sample()
    objective = objective_of(Probe())
    with refuse_host_waits(), pytest.raises(DeuxError, match="a prediction whose depth is"):
        objective(sample.batch, Prediction(sample.depth[:, 0]))
    with refuse_host_waits():
        objective(sample.batch, Prediction(sample.depth))


def test_the_terms_get_the_models_depth_range():
    """Truth at 50 m lies within the range of a model of 80 m, and beyond that of one of 10 m."""

    class Far(Model):
        supervised = True
        objective: ClassVar[LossSettings] = {"supervised_depth": 1.0}

        def __init__(self, max_depth: float) -> None:
            super().__init__()
            self.max_depth = max_depth

    sample = imperfect_sample()
    sample.batch.ground_truth = torch.full_like(sample.depth, 50.0)
    for max_depth, farthest in ((80.0, 50.0), (10.0, 10.0)):
        losses = make_objective(Far(max_depth))(sample.batch, Prediction(torch.full_like(sample.depth, 5.0)))
        assert float(losses.total) == pytest.approx((farthest - 5.0) / farthest)


def test_reconstructions_need_poses_from_somewhere():
    sample = imperfect_sample()
    poses = RelativePoses(sample.batch.source_from_target)
    expected = objective_of(Probe(LossNeed.RECONSTRUCTIONS))(sample.batch, Prediction(sample.depth))
    sample.batch.source_from_target = None
    objective = objective_of(Probe(LossNeed.RECONSTRUCTIONS))
    with pytest.raises(DeuxError, match=r"pose=simulator needs the poses .* use pose=learned"):
        objective(sample.batch, Prediction(sample.depth))
    found = objective(sample.batch, Prediction(sample.depth), poses)
    assert torch.equal(found.reconstructions.images, expected.reconstructions.images)
    assert objective_of(Probe())(sample.batch, Prediction(sample.depth)).reconstructions is None


def test_everything_is_float32_in_mixed_precision():
    sample, term = imperfect_sample(), Probe(LossNeed.RECONSTRUCTIONS, extras=("prior",))
    objective = objective_of(term)
    with torch.autocast("cpu", torch.bfloat16):
        losses = objective(sample.batch, Prediction(sample.depth.bfloat16(), {"prior": sample.depth.bfloat16()}))
    tensors = [
        losses.total,
        term.inputs.prediction.depth,
        term.inputs.prediction.extras["prior"],
        term.inputs.reconstructions.images,
    ]
    assert {tensor.dtype for tensor in tensors} == {torch.float32}


def test_terms_with_weights_of_their_own_are_part_of_the_module():
    class Learned(nn.Module, LossTerm):
        def __init__(self) -> None:
            super().__init__()
            self.scale = nn.Parameter(torch.ones(()))

        def forward(self, inputs):
            return self.scale * inputs.prediction.depth.mean()

        __call__ = nn.Module.__call__

    assert [name for name, _ in objective_of(Learned()).named_parameters()] == ["term_modules.a.scale"]
