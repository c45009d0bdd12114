import pickle
import time

import pytest
import torch

from deux.contracts import DepthModel, Prediction
from deux.inference.precision import FastPredictor, default_device, default_precision, tf32_convolutions


@pytest.mark.parametrize(
    ("amx", "avx512_bf16", "expected"),
    [(True, True, "bf16-mixed"), (False, True, "bf16-mixed"), (False, False, "32-true")],
)
def test_processor(monkeypatch, amx, avx512_bf16, expected):
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx)
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: avx512_bf16)
    assert default_precision("cpu") == expected


@pytest.mark.parametrize(("native", "expected"), [(True, "bf16-mixed"), (False, "32-true")])
def test_graphics_card(monkeypatch, native, expected):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: native)
    assert default_precision("auto") == expected


def test_the_device_is_the_processor_without_a_graphics_card(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert default_device("auto") == torch.device("cpu")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert default_device("auto") == torch.device("cuda")
    assert default_device("cpu") == torch.device("cpu")


@pytest.mark.parametrize("before", [True, False])
def test_tensorfloat_is_allowed_for_a_while_and_never_for_matrix_products(monkeypatch, before):
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", before)
    products = torch.get_float32_matmul_precision()
    for allowed in (True, False):
        with tf32_convolutions(allowed):
            assert torch.backends.cudnn.allow_tf32 is allowed
            assert torch.get_float32_matmul_precision() == products == "highest"
        assert torch.backends.cudnn.allow_tf32 is before


class Multiplied(DepthModel):
    """A matrix product, which autocast does in the precision that is on."""

    min_depth, max_depth = 0.1, 10.0

    def __init__(self) -> None:
        super().__init__()
        self.factor = torch.nn.Parameter(torch.eye(8) / 3.0)

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        self.product = sparse_depth @ self.factor
        return Prediction(self.product)


@pytest.mark.parametrize(("amx", "dtype"), [(True, torch.bfloat16), (False, torch.float32)])
def test_the_fast_predictor_computes_in_the_fastest_precision_and_answers_in_float32(monkeypatch, amx, dtype):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx)
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: False)
    model = Multiplied()
    intrinsics = torch.tensor([[8.0, 0.0, 3.5], [0.0, 8.0, 3.5], [0.0, 0.0, 1.0]])[None]
    predictor = FastPredictor(model)
    depth = predictor(torch.zeros(1, 3, 8, 8), torch.ones(1, 1, 8, 8), intrinsics)
    assert depth.device == predictor.device == torch.device("cpu")
    assert model.product.dtype == dtype
    assert depth.dtype == torch.float32
    assert torch.allclose(depth, torch.full_like(depth, 1 / 3), atol=2e-3)


def test_the_fast_predictor_declares_that_bits_do_not_depend_on_the_batch_on_a_cpu_alone():
    predictor = FastPredictor(Multiplied(), "cpu")
    assert predictor.batch_invariant
    predictor.device = torch.device("cuda")
    assert not predictor.batch_invariant


FRAME = (torch.rand(2, 3, 8, 8), torch.rand(2, 1, 8, 8), torch.eye(3).expand(2, 3, 3))


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_a_pickled_predictor_predicts_the_same_in_the_same_precision(precision):
    predictor = FastPredictor(Multiplied(), "cpu", precision)
    arrived = pickle.loads(pickle.dumps(predictor))
    assert arrived.precision == precision
    assert torch.equal(arrived(*FRAME), predictor(*FRAME))


def test_all_parts_stay_in_eval_mode_until_the_last_frame_is_done():
    class Slow(Multiplied):
        def forward(self, image, *inputs, **prepared):
            assert not self.training
            time.sleep(0.02 if image.mean() < 0.5 else 0.2)
            assert not self.training
            return super().forward(image, *inputs, **prepared)

    model = Slow().train()
    predictor = FastPredictor(model, "cpu")
    predictor._threads = 2
    predictor(torch.stack([torch.zeros(3, 8, 8), torch.ones(3, 8, 8)]), *FRAME[1:])
    assert model.training


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_weights_leave_a_card_for_the_card_of_the_process_in_which_they_arrive(monkeypatch):
    predictor = FastPredictor(Multiplied(), "gpu")
    sent = pickle.dumps(predictor)
    assert pickle.loads(sent).device.type == "cuda"
    assert next(predictor._model.parameters()).is_cuda
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    arrived = pickle.loads(sent)
    assert arrived.device == torch.device("cpu")
    assert arrived(*FRAME).shape == (2, 1, 8, 8)


def test_the_fast_predictor_gives_a_frame_the_same_bits_alone_and_in_a_batch_with_any_number_of_threads():
    class Threads(Multiplied):
        def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
            return Prediction(torch.full_like(sparse_depth, float(torch.get_num_threads())))

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        predictor = FastPredictor(Threads(), "cpu", "32-true")
        alone = predictor(*(part[:1] for part in FRAME))
        assert (torch.get_num_threads(), torch.unique(alone).item()) == (2, 1.0)
        assert torch.equal(predictor(*FRAME), alone.expand(2, -1, -1, -1))
    finally:
        torch.set_num_threads(before)
