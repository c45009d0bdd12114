import base64
import io
import logging
import math
import sys

import cv2
import numpy as np
import pytest
from PIL import Image

from deux.errors import DeuxError
from deux.mesh_files.gltf_file import read_gltf, referenced_by_gltf
from deux.mesh_files.mesh_parts import GREY

SQUARE = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # the image upright on the square
PIXELS = np.random.default_rng(4).integers(0, 256, (6, 10, 3), np.uint8)

# Four quarters of 16 x 8 pixels, red, green, blue and grey, encoded by Basis Universal 2.10's own encoder.
QUARTERS = np.repeat(np.repeat(np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [128] * 3]]), 4, axis=0), 8, axis=1)
KTX2 = {
    "etc1s": """
q0tUWCAyMLsNChoKAAAAAAEAAAAQAAAACAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAACwAAACUAAAAJAAAALgAAAAAAAAAjgAAAAAAAABGAQAAAAAA
AAMAAAAAAAAAAAAAAAAAAAAsAAAAAAAAAAIAKACjAQIAAwMAAAgAAAAAAAAAAAA/AAAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFzaXMgVW5pdmVy
c2FsIDIuMTAAAAQAAgAvAAAACQAAAC4AAAAAAAAAAAAAAAAAAAADAAAAAAAAAAAAAAAgwEQAAAAAAADiBAgwEQAAAAAABCk8QQLABIAAAAAAACICMAUA
AAAAAAJlEf5IAKyqqqpSVVVVBTTARAAAAAAAABKFAJgBAAAAAABAwggwN2AAAAAIgEVHoxMEABMAAAAAAAAIIABADis=""",
    "uastc": """
q0tUWCAyMLsNChoKAAAAAAEAAAAQAAAACAAAAAAAAAAAAAAAAQAAAAEAAAACAAAAaAAAACwAAACUAAAAJAAAAAAAAAAAAAAAAAAAAAAAAAC4AAAAAAAA
ADIAAAAAAAAAgAAAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAABAAAAAAAAAAAAB/AAAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFzaXMgVW5pdmVy
c2FsIDIuMTAAACi1L/0ggE0BANj3HwDgH3oAF+Af4B8CDwDg/x8C4AEQEPAfQAgFAGApYDHAtpkIFMAI""",
}


def square(gltf, material=None, **attributes):
    more = {} if material is None else {"material": material}
    return gltf.primitive({"POSITION": SQUARE, "TEXCOORD_0": UV, **attributes}, FACES, **more)


def test_factors_are_multiplied_as_they_are_stored(gltf):
    for factor in ([0.2, 0.4, 0.6, 0.1], [2, -1, 0.5, 1]):
        gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": factor}, "name": "paint"})
    gltf.add("materials", {"emissiveFactor": [1, 0, 0], "extensions": {"KHR_materials_unlit": {}}})
    for material in range(3):
        square(gltf, material)
    gltf.require("KHR_materials_unlit")
    read = [(part.material.name, part.material.color, part.uv) for part in read_gltf(gltf.save())]
    white = ("material 2", (255, 255, 255), None)
    assert read == [("paint", (51, 102, 153), None), ("paint", (255, 0, 128), None), white]


def test_light_that_is_baked_into_a_black_surface_is_what_is_seen(gltf):
    """As viewers add base colour and emission: of a black base colour the emission is left."""
    baked = gltf.textured(gltf.image(PIXELS))
    material = gltf.header["materials"][baked]
    material["emissiveTexture"] = material["pbrMetallicRoughness"].pop("baseColorTexture")
    material["pbrMetallicRoughness"]["baseColorFactor"] = [0, 0, 0, 1]
    material["emissiveFactor"] = [1, 1, 1]
    black = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}}
    lamp = gltf.add("materials", black | {"emissiveFactor": [0.2, 0.4, 0.6]})
    unlit = gltf.add("materials", black | {"emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_unlit": {}}})
    for number in (baked, lamp, unlit):
        square(gltf, number)
    parts = read_gltf(gltf.save())
    assert [part.material.color for part in parts] == [(255, 255, 255), (51, 102, 153), (0, 0, 0)]
    np.testing.assert_array_equal(parts[0].material.texture, PIXELS)
    np.testing.assert_allclose(parts[0].uv.reshape(-1, 2), (UV * [1, -1] + [0, 1])[FACES], atol=1e-6)


@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize("dtype", [np.float32, np.uint8, np.uint16])
def test_vertex_colours_of_every_type(gltf, width, dtype):
    expected = np.array([[255, 0, 51], [102, 153, 204], [0, 0, 0], [255, 255, 255]], np.uint8)
    stored = np.full((4, width), 255, np.uint8)
    stored[:, :3] = expected
    values = {np.float32: stored / np.float32(255), np.uint8: stored, np.uint16: stored.astype(np.uint16) * 257}[dtype]
    square(gltf, COLOR_0=values)
    (part,) = read_gltf(gltf.save())
    np.testing.assert_array_equal(part.vertex_colors, expected)
    assert part.material.color == (255, 255, 255), "without a material they are not darkened"


def test_surfaces_without_a_description_are_grey(gltf):
    square(gltf)
    (part,) = read_gltf(gltf.save())
    assert (part.material.color, part.material.texture, part.vertex_colors) == (GREY, None, None)


@pytest.mark.parametrize("extension", [True, False])
def test_any_set_of_coordinates(gltf, extension):
    """From the texture itself, or from KHR_texture_transform, which goes before it."""
    info = {"texCoord": 2} if not extension else {"extensions": {"KHR_texture_transform": {"texCoord": 2}}}
    square(gltf, gltf.textured(gltf.image(PIXELS), **info), TEXCOORD_2=UV * 0.5)
    (part,) = read_gltf(gltf.save())
    np.testing.assert_allclose(part.uv.reshape(-1, 2), (UV * [0.5, -0.5] + [0, 1])[FACES])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_normalised_integer_coordinates(gltf, dtype):
    index = gltf.accessor((UV * np.iinfo(dtype).max).astype(dtype), normalized=True)
    square(gltf, gltf.textured(gltf.image(PIXELS)), TEXCOORD_0=index)
    (part,) = read_gltf(gltf.save())
    np.testing.assert_allclose(part.uv.reshape(-1, 2), (UV * [1, -1] + [0, 1])[FACES])


def test_texture_transform(gltf):
    """The matrices of KHR_texture_transform, from its text."""
    u, v, angle, width, height = 0.25, -0.5, 0.3, 2, 3
    transform = {"offset": [u, v], "rotation": angle, "scale": [width, height]}
    gltf.require("KHR_texture_transform")
    square(gltf, gltf.textured(gltf.image(PIXELS), extensions={"KHR_texture_transform": transform}))
    (part,) = read_gltf(gltf.save())
    translation = np.array([[1, 0, u], [0, 1, v], [0, 0, 1]])
    cos, sin = math.cos(angle), math.sin(angle)
    rotation = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    moved = (translation @ rotation @ np.diag([width, height, 1]) @ np.c_[UV, np.ones(4)].T).T
    np.testing.assert_allclose(part.uv.reshape(-1, 2), (moved[:, :2] * [1, -1] + [0, 1])[FACES], atol=1e-6)


def test_a_quarter_turn_shows_the_image_turned(gltf):
    """Coordinates turned counter-clockwise by 90 degrees show the image turned clockwise, as the extension says."""
    transform = {"rotation": math.pi / 2, "offset": [0, 1]}
    square(gltf, gltf.textured(gltf.image(PIXELS), extensions={"KHR_texture_transform": transform}))
    (part,) = read_gltf(gltf.save())
    for position, expected in [((0, 4), PIXELS[-1, 0]), ((4, 4), PIXELS[0, 0]), ((4, 0), PIXELS[0, -1])]:
        corner = np.argwhere((part.vertices[part.faces][..., :2] == position).all(axis=2))[0]
        at = np.clip(part.uv[tuple(corner)], 0.01, 0.99)
        np.testing.assert_array_equal(sample(PIXELS, *at), expected)


def test_specular_glossiness(gltf):
    material = gltf.textured(gltf.image(PIXELS))
    described = gltf.header["materials"][material]
    texture = described["pbrMetallicRoughness"].pop("baseColorTexture")
    described["pbrMetallicRoughness"]["baseColorFactor"] = [0, 0, 0, 1]
    specular = {"diffuseFactor": [0.2, 0.4, 0.6, 1], "diffuseTexture": texture}
    described["extensions"] = {"KHR_materials_pbrSpecularGlossiness": specular}
    gltf.require("KHR_materials_pbrSpecularGlossiness")
    square(gltf, material)
    (part,) = read_gltf(gltf.save())
    assert part.material.color == (51, 102, 153)
    np.testing.assert_array_equal(part.material.texture, PIXELS)


def encoded(pixels, mode, form="PNG", **options):
    content = io.BytesIO()
    Image.fromarray(pixels).convert(mode).save(content, form, **options)
    return content.getvalue()


def sixteen_bits(pixels):
    """A PNG of 16 bits, grey or of colours."""
    written, content = cv2.imencode(".png", pixels.astype(np.uint16) * 257)
    assert written
    return content.tobytes()


GREY_PIXELS = PIXELS.mean(axis=2).astype(np.uint8)
EIGHT = PIXELS // 128 * 255
FLAT = np.full((8, 8, 3), (180, 90, 30), np.uint8)  # survives JPEG


@pytest.mark.parametrize(
    ("content", "pixels", "tolerance"),
    [
        (encoded(PIXELS, "RGB"), PIXELS, 0),
        (encoded(PIXELS, "RGBA"), PIXELS, 0),
        (encoded(GREY_PIXELS, "L"), GREY_PIXELS, 0),
        (encoded(GREY_PIXELS, "LA"), GREY_PIXELS, 0),
        (encoded(EIGHT, "P", transparency=bytes(range(0, 256, 32))), EIGHT, 0),
        (encoded(np.uint8(255) * (GREY_PIXELS > 99), "1"), np.uint8(255) * (GREY_PIXELS > 99), 0),
        (sixteen_bits(GREY_PIXELS), GREY_PIXELS, 0),
        (sixteen_bits(PIXELS[..., ::-1]), PIXELS, 0),
        (encoded(FLAT, "RGB", "JPEG", quality=95), FLAT, 3),
        (encoded(FLAT[..., 0], "L", "JPEG", quality=95), FLAT[..., 0], 3),
        (encoded(FLAT, "CMYK", "JPEG", quality=95), FLAT, 5),
        (encoded(PIXELS, "RGB", "WEBP", lossless=True), PIXELS, 0),
    ],
    ids=[
        "rgb",
        "rgba",
        "grey",
        "grey-alpha",
        "palette",
        "bits",
        "grey16",
        "rgb16",
        "jpeg",
        "grey-jpeg",
        "cmyk",
        "webp",
    ],
)
@pytest.mark.parametrize("place", ["file", "view"])
def test_images_of_every_kind(gltf, content, pixels, tolerance, place):
    # The suffix and the type are those of a PNG, whatever it is: the content counts.
    if place == "file":
        (gltf.folder / "my wall.png").write_bytes(content)
        image = {"uri": "my%20wall.png"}
    else:
        image = {"bufferView": gltf.view(content), "mimeType": "image/png"}
    square(gltf, gltf.textured(image))
    (part,) = read_gltf(gltf.save())
    read = part.material.texture
    expected = np.broadcast_to(pixels[..., None] if pixels.ndim == 2 else pixels, read.shape)
    assert read.dtype == np.uint8
    np.testing.assert_allclose(read.astype(int), expected.astype(int), atol=tolerance)


@pytest.mark.parametrize("form", ["PNG", "JPEG"])
def test_large_images_are_no_attack(gltf, form, monkeypatch):
    """Atlases of scans have more pixels than Pillow opens without a warning, or at all."""
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    (gltf.folder / "wall.img").write_bytes(encoded(FLAT, "RGB", form))
    square(gltf, gltf.textured({"uri": "wall.img"}))
    np.testing.assert_allclose(read_gltf(gltf.save())[0].material.texture.astype(int), FLAT.astype(int), atol=5)


@pytest.mark.parametrize("form", ["WEBP", "AVIF"])
def test_an_image_of_another_extension(gltf, form):
    if form not in Image.registered_extensions().values():
        pytest.skip(f"this build of Pillow reads no {form}")
    (gltf.folder / "wall.img").write_bytes(encoded(FLAT, "RGB", form))
    material = gltf.textured({"uri": "wall.img"})
    extension = f"EXT_texture_{form.lower()}"
    gltf.header["textures"][0] = {"extensions": {extension: {"source": 0}}}
    gltf.require(extension)
    square(gltf, material)
    path = gltf.save()
    assert referenced_by_gltf(path) == ["wall.img"]
    np.testing.assert_allclose(read_gltf(path)[0].material.texture.astype(int), FLAT.astype(int), atol=5)


def test_an_image_of_the_core_goes_before_another_form(gltf):
    material = gltf.textured(gltf.image(PIXELS))
    gltf.header["textures"][0]["extensions"] = {"KHR_texture_basisu": {"source": 1}}
    gltf.add("images", {"uri": "gone.ktx2"})
    square(gltf, material)
    np.testing.assert_array_equal(read_gltf(gltf.save())[0].material.texture, PIXELS)


def test_an_image_of_several_materials_is_decoded_once(gltf):
    first = gltf.textured(gltf.image(PIXELS))
    second = gltf.add("materials", {**gltf.header["materials"][first], "name": "again"})
    for material in (first, second, first):
        square(gltf, material)
    a, b, c = (part.material for part in read_gltf(gltf.save()))
    assert a.texture is b.texture
    assert a is c
    assert b.name == "again"


def test_images_that_nothing_shows_are_not_decoded(gltf):
    gltf.textured({"uri": "gone.png"})
    square(gltf)
    assert len(read_gltf(gltf.save())) == 1


def sample(texture, u, v):
    """The pixel of a repeated texture, as the contract of materials has it: (0, 0) at the bottom left."""
    height, width = texture.shape[:2]
    rows, columns = np.floor((1 - np.asarray(v)) * height), np.floor(np.asarray(u) * width)
    return texture[rows.astype(int) % height, columns.astype(int) % width]


def wrapped(t, size, wrap):
    """Index of the pixel of a coordinate, one axis of glTF's samplers."""
    if wrap == 33071:
        return np.clip(np.floor(t * size), 0, size - 1).astype(int)
    if wrap == 33648:
        t = np.abs(np.mod(t + 1, 2) - 1)
    return np.floor(t * size).astype(int) % size


@pytest.mark.parametrize("wrap_s", [10497, 33071, 33648])
@pytest.mark.parametrize("wrap_t", [10497, 33071, 33648])
@pytest.mark.parametrize(("low", "high"), [((-0.35, 0.1), (1.6, 1.45)), ((-1.3, -0.4), (0.2, 2.3)), ((0, 0), (1, 1))])
def test_wrap_modes(gltf, wrap_s, wrap_t, low, high):
    sampler = {"wrapS": wrap_s, "wrapT": wrap_t}
    uv = (np.array(low) + UV * (np.array(high) - low)).astype(np.float32)
    square(gltf, gltf.textured(gltf.image(PIXELS), sampler), TEXCOORD_0=uv)
    (part,) = read_gltf(gltf.save())
    weights = np.random.default_rng(7).dirichlet([1, 1, 1], 500)
    ours = weights @ part.uv.astype(float)
    theirs = weights @ uv.astype(float)[FACES].reshape(2, 3, 2)
    expected = PIXELS[wrapped(theirs[..., 1], 6, wrap_t), wrapped(theirs[..., 0], 10, wrap_s)]
    equal = (sample(part.material.texture, ours[..., 0], ours[..., 1]) == expected).all(axis=-1)
    assert equal.mean() > 0.995, "but for coordinates between two pixels"
    if (low, high) == ((0, 0), (1, 1)):
        assert part.material.texture.shape == PIXELS.shape, "what stays inside is not enlarged"


def test_a_clamped_texture_is_not_enlarged_without_end(gltf, caplog):
    sampler = {"wrapS": 33071, "wrapT": 33071}
    square(gltf, gltf.textured(gltf.image(PIXELS), sampler), TEXCOORD_0=UV * 1000)
    with caplog.at_level(logging.WARNING):
        (part,) = read_gltf(gltf.save())
    assert part.material.texture.size <= 16 * PIXELS.size
    assert "images[0] is clamped, but its coordinates far exceed the image" in caplog.text


def test_coordinates_that_are_missing_are_reported(gltf, caplog):
    material = gltf.textured(gltf.image(PIXELS), texCoord=1)
    gltf.header["materials"][material]["pbrMetallicRoughness"]["baseColorFactor"] = [0.2, 0.4, 0.6, 1]
    square(gltf, material)
    with caplog.at_level(logging.WARNING):
        (part,) = read_gltf(gltf.save())
    assert "meshes[0].primitives[0] has no TEXCOORD_1 for its texture" in caplog.text
    assert (part.material.color, part.material.texture, part.uv) == ((51, 102, 153), None, None)


def ktx2_square(gltf, content, image):
    (gltf.folder / image["uri"]).write_bytes(content)
    material = gltf.textured(image)
    gltf.header["textures"][0] = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    gltf.require("KHR_texture_basisu")
    square(gltf, material)
    return gltf.save()


@pytest.fixture
def basis():
    return pytest.importorskip("opengl_basisu", reason="opengl-basisu is not installed: pip install -e '.[compressed]'")


@pytest.mark.parametrize("form", KTX2)
@pytest.mark.parametrize("name", ["wall.ktx2", "wall.img"])
def test_basis_textures(gltf, basis, form, name):
    path = ktx2_square(gltf, base64.b64decode(KTX2[form]), {"uri": name})
    (part,) = read_gltf(path)
    np.testing.assert_allclose(part.material.texture.astype(int), QUARTERS, atol=2)


@pytest.mark.parametrize(
    "image",
    [{"uri": "wall.ktx2"}, {"uri": "wall.img", "mimeType": "image/ktx2"}, {"uri": "wall.img"}],
)
def test_basis_textures_without_their_package(gltf, image, monkeypatch):
    path = ktx2_square(gltf, base64.b64decode(KTX2["etc1s"]), image)
    monkeypatch.setitem(sys.modules, "opengl_basisu", None)
    with pytest.raises(DeuxError, match=r'KTX2.*pip install "deux\[compressed\]".*HM3D the archive _glb'):
        read_gltf(path)


@pytest.mark.parametrize(
    ("content", "image"),
    [
        (base64.b64decode(KTX2["uastc"])[:150], {"uri": "wall.img"}),
        (base64.b64decode(KTX2["uastc"])[:12] + (37).to_bytes(4, "little") + bytes(100), {"uri": "wall.img"}),
        (b"nothing", {"uri": "wall.ktx2"}),
    ],
)
def test_ktx2_of_another_kind_is_refused(gltf, basis, content, image):
    with pytest.raises(DeuxError, match=r"has a KTX2 texture, images\[0\], that cannot be decoded"):
        read_gltf(ktx2_square(gltf, content, image))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (encoded(PIXELS, "RGB")[:60], r"images\[0\] is damaged"),
        (encoded(FLAT, "RGB", "JPEG")[:-60], r"images\[0\] is damaged: .*[Tt]runcated"),
        (b"nothing", r"images\[0\] is damaged: it is not a PNG, JPEG, WebP or other image"),
        (None, r"needs wall.png, which is not in"),
    ],
)
def test_images_that_cannot_be_read_are_named(gltf, content, message):
    if content is not None:
        (gltf.folder / "wall.png").write_bytes(content)
    square(gltf, gltf.textured({"uri": "wall.png"}))
    with pytest.raises(DeuxError, match=message):
        read_gltf(gltf.save())


def test_textures_in_a_form_that_is_not_read_are_refused(gltf):
    square(gltf, gltf.textured({"uri": "wall.dds"}))
    gltf.header["textures"][0] = {"extensions": {"MSFT_texture_dds": {"source": 0}}}
    with pytest.raises(DeuxError, match=r"no image for textures\[0\] except in unsupported formats .*MSFT_texture_dds"):
        read_gltf(gltf.save())
