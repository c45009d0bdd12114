"""The preview of recorded frames."""

import numpy as np
import pytest

from deux.figures.frame_preview import PreviewFrame, draw_preview


@pytest.mark.parametrize("whole", [True, False])
def test_each_frame_is_a_row_of_four_panels(whole: bool) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (20, 30, 3), np.uint8)
    truth = rng.uniform(1.0, 4.0, (20, 30)).astype(np.float32)
    points = np.where(rng.random(truth.shape) < 0.1, truth, 0.0)
    rebuilt = np.where(rng.random((20, 30, 1)) < 0.5, image, np.nan)
    frames = [
        PreviewFrame("hall 000001", image, points, truth, rebuilt)
        if whole
        else PreviewFrame("a", image, 0 * points, None, None)
    ] * 2
    figure = draw_preview(frames)
    panels = figure.axes[:-1]
    assert len(panels) == 8
    assert [panel.get_title() for panel in panels[:4]] == [
        "image",
        "sparse depth",
        "ground truth",
        "rebuilt from the neighbour",
    ]
    np.testing.assert_array_equal(panels[0].images[-1].get_array(), image)
    (scatter,) = panels[1].collections
    assert len(scatter.get_offsets()) == np.count_nonzero(frames[0].sparse_depth)
    assert [len(panel.images) for panel in panels[:4]] == ([2, 1, 2, 2] if whole else [2, 1, 1, 1])
    if whole:
        assert scatter.get_clim() == pytest.approx(
            (0.0, np.percentile(np.concatenate([points[points > 0], truth.ravel()]), 98))
        )
