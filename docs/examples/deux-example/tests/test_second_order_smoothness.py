import torch

from deux.contracts import Batch, LossInputs, LossTerm, Prediction
from deux.testing.losses import DEPTH_RANGE, LossTermSuite
from deux_example.second_order_smoothness import SecondOrderSmoothness


class TestSecondOrderSmoothness(LossTermSuite):
    def make_term(self) -> LossTerm:
        return SecondOrderSmoothness()


def test_a_slanted_plane_costs_nothing_and_a_parabola_its_curvature() -> None:
    blank = torch.zeros(1, 1, 5, 8)
    batch = Batch(blank.repeat(1, 3, 1, 1), blank, blank, blank, blank, torch.eye(3)[None], torch.eye(4)[None, None])
    x = torch.arange(8.0).expand(1, 1, 5, 8)
    term = SecondOrderSmoothness()
    plane, parabola = (LossInputs(batch, Prediction(1 + 0.5 * depth), None, DEPTH_RANGE) for depth in (x, x**2))
    assert term(plane) == 0
    torch.testing.assert_close(term(parabola), torch.tensor(1.0))
