import torch

from deux.contracts import Batch, LossTerm, Prediction
from deux.testing.losses import LossTermSuite
from deux_example.second_order_smoothness import SecondOrderSmoothness


class TestSecondOrderSmoothness(LossTermSuite):
    def make_term(self) -> LossTerm:
        return SecondOrderSmoothness()


def test_a_slanted_plane_costs_nothing_and_a_parabola_its_curvature() -> None:
    blank = torch.zeros(1, 1, 5, 8)
    batch = Batch(blank.repeat(1, 3, 1, 1), blank, blank, blank, blank, torch.eye(3)[None], torch.eye(4)[None, None])
    x = torch.arange(8.0).expand(1, 1, 5, 8)
    term = SecondOrderSmoothness()
    assert term(batch, Prediction(1 + 0.5 * x), None) == 0
    torch.testing.assert_close(term(batch, Prediction(1 + 0.5 * x**2), None), torch.tensor(1.0))
