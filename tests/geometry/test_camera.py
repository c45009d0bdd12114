import math

import numpy as np
import pytest

from deux.errors import DeuxError
from deux.geometry.camera import Camera


def test_focal_length_of_a_right_angle_is_half_the_width():
    assert Camera(width=400, hfov=90.0).focal_length == pytest.approx(200.0)


def test_rays_span_the_field_of_view_from_pixel_edge_to_pixel_edge():
    camera = Camera(width=64, height=48, hfov=70.0)
    rays = camera.rays()
    half_pixel = 0.5 / camera.focal_length
    angle = math.degrees(math.atan(rays[0, -1, 0] + half_pixel) - math.atan(rays[0, 0, 0] - half_pixel))
    assert angle == pytest.approx(70.0)


def test_rays_invert_the_intrinsics():
    camera = Camera(width=8, height=6, hfov=60.0)
    pixels = camera.rays() @ camera.intrinsics.T
    assert camera.rays().shape == (6, 8, 3)
    np.testing.assert_allclose(pixels[4, 5], [5.0, 4.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(pixels[0, 0], [0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"width": 0}, r"camera\.width is 0: it must be at least 1\."),
        ({"hfov": 180.0}, r"camera\.hfov is 180\.0: it must be above 0 and below 180\."),
        ({"width": 10**6, "height": 10**6}, r"a camera of 1,000,000 x 1,000,000 pixels would take .* GiB of memory"),
        ({"min_depth": math.nan}, r"camera\.min_depth is nan: it must be at least 0\."),
        ({"min_depth": 2.0, "max_depth": 2.0}, r"camera\.max_depth is 2\.0: it must be above 2\.0\."),
    ],
)
def test_a_camera_that_cannot_be_is_refused(settings, sentence):
    with pytest.raises(DeuxError, match=sentence):
        Camera(**settings)
