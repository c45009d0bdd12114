import io

import numpy as np
import pytest
from PIL import Image, UnidentifiedImageError

from deux.errors import DeuxError
from deux.io.image_opening import FRAME_BYTES, check_pixels, open_image


def test_the_limit_is_memory_and_not_a_number_of_pixels(monkeypatch, leave_memory):
    content = io.BytesIO()
    Image.fromarray(np.zeros((30, 40, 3), np.uint8)).save(content, "PNG")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    with open_image(content, "a.png", FRAME_BYTES) as image:
        assert image.size == (40, 30)
    assert Image.MAX_IMAGE_PIXELS == 10
    leave_memory(2 * 40 * 30 * FRAME_BYTES - 1)
    with pytest.raises(DeuxError, match=r"a\.png, of 40 x 30 pixels, would take .* GiB of memory.*: make it smaller\."):
        open_image(content, "a.png", FRAME_BYTES)
    check_pixels((40, 29), "a.png", FRAME_BYTES)


def test_what_is_no_image_is_pillows_error():
    with pytest.raises(UnidentifiedImageError):
        open_image(io.BytesIO(b"nothing"), "a.png", FRAME_BYTES)
