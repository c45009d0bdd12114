import matplotlib
import numpy as np
import pytest
from PIL import Image

from deux.figures.depth_map import draw_depth
from deux.figures.drawing import save_figure


def test_the_scale_tells_the_depth():
    """Colours of the picture, looked up in the scale's own ends and colour map, are the depth that was drawn."""
    depth = np.linspace(1.0, 5.0, 60 * 80).reshape(60, 80)
    figure = draw_depth(depth)
    axes, bar = figure.axes
    (picture,) = axes.images
    assert picture.get_clim() == pytest.approx((1.04, 4.96), abs=1e-3)
    assert bar.get_ylabel() == "depth [m]"
    inner = depth[30]
    expected = matplotlib.colormaps["turbo"]((inner - 1.04) / 3.92)
    np.testing.assert_allclose(picture.to_rgba(inner), expected, atol=0.01)


@pytest.mark.parametrize("shape", [(1, 1), (2, 500), (500, 2), (60, 80)])
@pytest.mark.parametrize("metres", [0.0, 2.0])
def test_any_map_can_be_drawn(tmp_path, shape, metres):
    """Also without any depth, of one depth only, and far longer than wide; warnings are errors here."""
    path = save_figure(draw_depth(np.full(shape, metres)), tmp_path / "depth.png")
    with Image.open(path) as picture:
        assert min(picture.size) > 200
