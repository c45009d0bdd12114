"""The pictures of a depth video: panels, sizes and colours."""

import matplotlib
import numpy as np

from deux.figures.depth_video import LARGEST_PANEL, color_map, draw_video_frame


def test_panels_stand_side_by_side() -> None:
    image = np.random.default_rng(0).integers(0, 256, (30, 40, 3), np.uint8)
    depth = np.linspace(1.0, 3.0, 1200, dtype=np.float32).reshape(30, 40)
    picture = draw_video_frame(image, depth, (1.0, 3.0))
    assert picture.shape == (30, 80, 3)
    np.testing.assert_array_equal(picture[:, :40], image)
    np.testing.assert_array_equal(picture[:, 40:], color_map(depth, (1.0, 3.0), "turbo"))
    assert draw_video_frame(image, depth, (1.0, 3.0), np.full((30, 40), 0.5)).shape == (30, 120, 3)


def test_large_frames_are_scaled_down() -> None:
    picture = draw_video_frame(np.zeros((1080, 1920, 3), np.uint8), np.ones((1080, 1920)), (0.5, 2.0))
    assert picture.shape == (LARGEST_PANEL, 1280, 3)


def test_colours_are_those_of_matplotlib_and_grey_means_none() -> None:
    values = np.array([[0.0, np.nan, 1.0, 2.0, 3.0, 9.0]])
    colors = color_map(values, (1.0, 3.0), "viridis")[0]
    assert colors[0].tolist() == colors[1].tolist() == [217] * 3
    expected = matplotlib.colormaps["viridis"]([0, 128, 255, 255])[:, :3] * 255
    np.testing.assert_allclose(colors[2:], expected, atol=1.0)
