import pytest
import torch
from lightning.pytorch import Callback
from torch import nn

from deux.contracts import Prediction
from deux.errors import DeuxError
from deux.metrics.mean_errors import DepthErrors
from deux.testing.losses import perfect_sample
from deux.training.fit import make_trainer
from deux.training.module import DepthCompletion
from deux.training.network_precision import NetworkPrecision, network_precision
from deux.training.objective import make_objective
from deux.training.pose_source import make_pose_source

WEIGHTS = {
    "32-true": torch.float32,
    "bf16-mixed": torch.float32,
    "16-mixed": torch.float32,
    "bf16-true": torch.bfloat16,
    "64-true": torch.float64,
}
CLIPPING = {
    "unclipped": {},
    "norm": {"gradient_clip_val": 1e-3},
    "value": {"gradient_clip_val": 1e-3, "gradient_clip_algorithm": "value"},
}


class Witness(Callback):
    """Keeps what a training computes with."""

    def __init__(self):
        self.weights, self.objective_inputs, self.gradients = set(), set(), []

    def on_train_start(self, trainer, pl_module):
        def see(_, inputs):
            batch, _, poses = inputs
            tensors = [batch.image, batch.sparse_depth, batch.intrinsics, batch.source_from_target, batch.ground_truth]
            self.objective_inputs |= {x.dtype for x in (*tensors, poses.source_from_target)}
            self.objective_inputs.add(torch.get_default_dtype())

        pl_module.objective.register_forward_pre_hook(see)
        trainer.optimizers[0].register_step_post_hook(lambda optimizer, *_: self._see_gradients(optimizer))
        self.weights |= {weight.dtype for weight in pl_module.parameters()}

    def _see_gradients(self, optimizer):
        gradients = [weight.grad for group in optimizer.param_groups for weight in group["params"]]
        self.gradients.append(torch.cat([gradient.flatten().double() for gradient in gradients]))


@pytest.fixture
def two_steps(small_model, fit):
    """Trains for two steps and validates; returns the module and what was seen."""

    def run(precision, accelerator="cpu", model=None, **arguments):
        torch.manual_seed(0)
        witness, model = Witness(), model or small_model()
        objective, poses = make_objective(model), make_pose_source("learned", model)
        module = DepthCompletion(model, objective, poses, metrics=DepthErrors())
        trainer = make_trainer(
            {
                "precision": precision,
                "accelerator": accelerator,
                "max_steps": 2,
                "limit_val_batches": 1,
                "callbacks": [witness],
                "logger": False,
                "enable_checkpointing": False,
                "enable_progress_bar": False,
                "enable_model_summary": False,
                **arguments,
            }
        )
        before = [weight.detach().clone() for weight in module.parameters()]
        loader = torch.utils.data.DataLoader([perfect_sample().batch] * 2, batch_size=None)
        trainer.fit(module, loader, loader)
        losses = [trainer.callback_metrics[f"{stage}/loss"] for stage in ("train", "validation")]
        assert all(bool(loss.isfinite()) and loss.dtype == torch.float32 for loss in losses)
        assert any(not torch.equal(x, y.cpu()) for x, y in zip(before, module.parameters(), strict=True))
        return module, witness

    return run


pytestmark = [
    pytest.mark.filterwarnings("ignore:.*does not have many workers"),
    pytest.mark.filterwarnings("ignore:You passed .*precision='16-mixed'.* but AMP with fp16 is not supported on CPU"),
]


@pytest.mark.parametrize("clipping", CLIPPING)
@pytest.mark.parametrize("precision", WEIGHTS)
def test_every_precision_trains_with_and_without_clipping(two_steps, precision, clipping):
    module, seen = two_steps(precision, **CLIPPING[clipping])
    assert seen.weights == {WEIGHTS[precision]}
    assert seen.objective_inputs == {torch.float32}
    assert {weight.dtype for weight in module.parameters()} == {torch.float32}
    size = seen.gradients[0].norm() if clipping == "norm" else seen.gradients[0].abs().max()
    assert size == pytest.approx(1e-3, rel=1e-2) if clipping != "unclipped" else size > 1e-2


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("clipping", CLIPPING)
@pytest.mark.parametrize("precision", WEIGHTS)
def test_every_precision_trains_on_a_gpu(two_steps, precision, clipping):
    # float16 on a card begins with so large a scale of the loss that the first steps overflow and are left out.
    steps = {"max_steps": 60} if precision == "16-mixed" else {}
    _, seen = two_steps(precision, "gpu", devices=1, **steps, **CLIPPING[clipping])
    assert seen.weights == {WEIGHTS[precision]}
    assert seen.objective_inputs == {torch.float32}


@pytest.mark.parametrize("precision", ["bf16-true", "64-true"])
def test_a_network_may_give_its_layers_float32(small_model, two_steps, precision):
    """As the published networks give it to their last layer, which computes in the precision of its weights."""

    class Careful(small_model):
        def __init__(self):
            super().__init__()
            self.output = nn.Conv2d(1, 1, 1)

        def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
            depth = super().forward(image, sparse_depth, validity, intrinsics).depth
            with torch.autocast(image.device.type, enabled=False):
                output = self.output(depth.float())
            computed.add(output.dtype)
            return Prediction(output.abs().clamp(self.min_depth, self.max_depth))

    computed = set()
    two_steps(precision, model=Careful())
    assert computed == {WEIGHTS[precision]}


def test_float64_is_more_precise_and_bfloat16_less(small_model):
    torch.manual_seed(0)
    module = DepthCompletion(small_model(), make_objective(small_model()))
    batch, depth = perfect_sample().batch, {}
    for precision in (None, "64-true", "bf16-true"):
        plugin = network_precision(precision)
        if plugin is not None:
            plugin.convert_module(module)
        with torch.no_grad():
            depth[precision] = module(batch).depth
            predicted = module.model.predict(batch.image, batch.sparse_depth, batch.intrinsics)
            torch.testing.assert_close(predicted, depth[precision].float(), rtol=1e-6, atol=1e-6)
        if plugin is not None:
            plugin.teardown()
    assert 0 < (depth["64-true"] - depth[None]).abs().max() < 1e-5
    assert 1e-4 < (depth["bf16-true"] - depth[None]).abs().max() < 0.1


@pytest.mark.parametrize("name", [64, "64", "64-true"])
def test_lightnings_other_names_of_float64(name):
    plugin = network_precision(name)
    assert isinstance(plugin, NetworkPrecision)
    assert plugin.precision == "64-true"


@pytest.mark.parametrize("name", [None, 32, "32-true", 16, "16-mixed", "bf16", "bf16-mixed"])
def test_what_lightning_does_well_is_left_to_it(name):
    assert network_precision(name) is None


@pytest.mark.parametrize(
    ("precision", "sentence"),
    [
        ("16-true", r"trainer\.precision=16-true .* underflow: use bf16-mixed"),
        ("transformer-engine", r"lightning.Trainer refuses the settings under trainer: .*transformer_engine"),
        ("bf15", r"trainer\.precision must be .*'bf16-mixed'.* but is 'bf15'"),
        ([64], r"trainer\.precision must be .* but is \[64\]"),
    ],
)
def test_precisions_that_do_not_train_are_refused(precision, sentence):
    with pytest.raises(DeuxError, match=sentence):
        make_trainer({"precision": precision, "accelerator": "cpu", "logger": False})
