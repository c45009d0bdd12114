"""Pictures, depth maps, arrays, camera matrices and lists that are wrong on purpose."""

import io
import json
import struct
import tarfile
import zipfile

import numpy as np
import pytest
from hostile import NO_JSON, Case, changed_values, damaged_bytes, texts
from PIL import Image
from png_files import chunk, png

from deux.collection.explored_map import explored_map, mean_uncertainty
from deux.collection.free_floor import read_free_floor
from deux.contracts import FrameReference, Robot
from deux.data.dataset_reader import DatasetReader
from deux.geometry.camera import Camera
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.camera_files import read_any_depth, read_any_image, read_any_intrinsics
from deux.io.images import read_depth, read_fraction, read_image, read_labels
from deux.io.layout import SequencePaths
from deux.mesh_files.part_files import read_texture
from deux_plugins.readers.kitti import Kitti
from deux_plugins.readers.parts.trajectory_files import read_trajectory
from deux_plugins.readers.triplet_images import TripletImages
from deux_plugins.readers.webdataset import Shards

PIXELS = np.random.default_rng(0).integers(0, 255, (8, 8, 3), np.uint8)
IMAGES = (read_any_image, read_image, read_texture)
DEPTHS = (read_any_depth, read_depth, read_fraction, read_labels)


def encoded(pixels: np.ndarray, kind: str) -> bytes:
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, kind)
    return content.getvalue()


def test_pictures(campaign):
    whole = encoded(PIXELS, "PNG")
    bombs = [Case("text of 100 MB", whole[:33] + chunk(b"zTXt", b"a\0\0" + bomb(10**8)) + whole[33:])]
    sizes = ((30_000, 30_000), (2**31 - 1, 2**31 - 1), (0, 0), (1, 2**31 - 1))
    bombs += [Case(f"header of {width} x {height}", header(width, height)) for width, height in sizes]
    bombs.append(Case("its ends alone", whole[:8] + whole[-8:]))
    for read in IMAGES:
        path = campaign.folder / "a.png"
        campaign.run([*damaged_bytes(whole, 60), *bombs], path, lambda: read(path))
    for kind, suffix in (("JPEG", "jpg"), ("GIF", "gif"), ("TIFF", "tif"), ("WEBP", "webp"), ("BMP", "bmp")):
        for read in (read_any_image, read_texture):
            path = campaign.folder / f"a.{suffix}"
            campaign.run(damaged_bytes(encoded(PIXELS, kind), 30), path, lambda: read(path))
    campaign.end()


def test_depth_maps(campaign):
    whole = encoded(PIXELS[..., 0].astype(np.uint16) * 200, "PNG")
    bombs = [Case("12,000 x 12,000", png(12_000, 12_000, 16, 0))]
    bombs += [Case(f"header of {w} x {h}", header(w, h, 16, 0)) for w, h in ((2**31 - 1, 2**31 - 1), (0, 0))]
    path = campaign.folder / "a.png"
    for read in DEPTHS:
        campaign.run([*damaged_bytes(whole, 60), *bombs], path, lambda: read(path))
    campaign.end()


def bomb(size: int) -> bytes:
    import zlib

    return zlib.compress(bytes(size), 9)


def header(width: int, height: int, bits: int = 8, mode: int = 2) -> bytes:
    """A PNG file whose header says so and whose pixels are those of one row."""
    rows = png(1, 1, bits, mode)
    return rows[:8] + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, mode, 0, 0, 0)) + rows[33:]


def npy(shape: str, dtype: str = "'<f4'", content: bytes = bytes(16), order: str = "False") -> bytes:
    """A .npy file with a header of this text."""
    text = f"{{'descr': {dtype}, 'fortran_order': {order}, 'shape': {shape}, }}".encode()
    text += b" " * (-(10 + len(text) + 1) % 64) + b"\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text + content


SHAPES = ("(100000, 100000)", "(10**6, 4)", "(-1, 4)", "()", "(0, 0)", "(2, 2)", "(2, 2.0)", "'a'", "None", "(2,) * 40")
SHAPES += ("[2, 2]", f"({2**62}, 4)", f"({10**400},)", "(" * 3000 + ")" * 3000, "(True, 4)", "(4,)", "(1, 4, 1)")
DTYPES = (
    "'|O'",
    "'<f8'",
    "'<f2'",
    "'<c16'",
    "'|V2000000000'",
    "'<U10'",
    "'<M8[s]'",
    "'>f4'",
    "'|b1'",
    "[('a', '<f4')]",
)
DTYPES += ("3", "None", "'nonsense'", "'<g'", "'<i4'", "__import__('os').system('touch marker')")


def test_arrays(campaign, monkeypatch):
    monkeypatch.chdir(campaign.folder)
    cases = [Case(f"shape {shape[:30]}", npy(shape)) for shape in SHAPES]
    cases += [Case(f"type {dtype}", npy("(2, 2)", dtype)) for dtype in DTYPES]
    cases += [Case(f"order {order}", npy("(2, 2)", order=order)) for order in ("True", "None", "3")]
    for value in (np.nan, np.inf, -1, 1e38):
        cases.append(Case(f"value {value}", npy("(2, 2)", content=np.full(4, value, np.float32).tobytes())))
    cases += [*damaged_bytes(npy("(2, 2)"), 60), Case("pickle", b"\x80\x04c" + b"os\nsystem\n(S'touch marker'\ntR.")]
    path = campaign.folder / "a.npy"
    for read in (read_any_depth, read_any_intrinsics):
        campaign.run(cases, path, lambda: read(path))
    data = campaign.folder / "set" / "data" / "hall"
    data.mkdir(parents=True)
    reader = TripletImages(campaign.folder / "set")
    campaign.run(cases, data / "K.npy", lambda: reader.intrinsics(FrameReference("hall", "0")))
    campaign.end()


WORDS = (
    "nan",
    "inf",
    "-1",
    "0",
    "1e-30",
    "1e30",
    "1e400",
    "9" * 400,
    "x",
    "",
    "null",
    "[]",
    "1,5",
    "true",
    "\0",
    "a" * 9000,
)


def other_words(text: str) -> list[Case]:
    words = text.split(" ")
    changed = [
        Case(f"word {k} is {new[:20]!r}", " ".join([*words[:k], new, *words[k + 1 :]]).encode())
        for k in range(len(words))
        for new in WORDS
    ]
    return [*changed, *texts("", " ", "\n", "1", "[" * 10_000, "0 " * 100_000), Case("binary", bytes(range(256)))]


def test_camera_matrices(campaign):
    file, poses = campaign.folder / "K.txt", campaign.folder / "pose.txt"
    campaign.run(other_words("30 0 30\n0 31 22\n0 0 1".replace("\n", " ")), file, lambda: read_intrinsics(file))
    campaign.run(other_words("1 0 0 0.1 0 1 0 0.2 0 0 1 0.3"), poses, lambda: read_pose(poses))
    line = "1 0 0 0.1 0 1 0 0.2 0 0 1 0.3"
    for text in (line, "0.1 0 0 0 0 0 0 1"):
        campaign.run(other_words(text), poses, lambda: read_trajectory(poses, ["0.1"]))
    campaign.end()


def walk_through(reader, split="train"):
    """Read all of a data set's frames, as training does."""
    for target, sources in reader.triplets(split, (-1, -2)):
        image = reader.image(target)
        reader.intrinsics(target)
        for frame in (target, *sources):
            reader.pose(frame)
            assert reader.image(frame).shape == image.shape
        reader.sparse_depth(target)
        reader.ground_truth(target)


def dataset(folder, lists=True):
    """A data set of three frames in VOID's layout; gives its list."""
    base = folder / "set" / "data" / "hall"
    for kind in ("image", "sparse_depth", "ground_truth", "absolute_pose"):
        (base / kind).mkdir(parents=True)
    depth = np.full((8, 8), 512, np.uint16)
    for k in range(3):
        Image.fromarray(PIXELS).save(base / "image" / f"{k:06d}.png")
        for kind in ("sparse_depth", "ground_truth"):
            Image.fromarray(depth).save(base / kind / f"{k:06d}.png")
        np.savetxt(base / "absolute_pose" / f"{k:06d}.txt", np.eye(4)[:3])
    (base / "K.txt").write_text("8 0 4\n0 8 4\n0 0 1\n")
    names = [f"set/data/hall/image/{k:06d}.png" for k in (2, 1, 0)]
    (folder / "set" / "train_image.txt").write_text("\n".join(names))
    return folder / "set", "\t".join(names)


LINES = (
    "",
    "/",
    "data",
    "a/data/b/image/../../../../x.png",
    "a/data/../image/0.png",
    "\0/data/b/image/c.png",
    "x" * 9000,
)
LINES += (
    f"a/data/{'b' * 300}/image/c.png",
    "a/data/hall/image/",
    "a/data/hall/image/000009.png",
    "\x1b[31m/data/b/c/d.png",
)
LINES += ("\t\t", "null", "[]", '{"a": 1}', "\ud800".encode("utf-8", "surrogatepass").decode("latin1"))


def test_lists(campaign):
    folder, line = dataset(campaign.folder)
    parts = line.split("\t")
    cases = [
        Case(f"name {k} is {new[:30]!r}", "\t".join([*parts[:k], new, *parts[k + 1 :]]).encode())
        for k in range(3)
        for new in LINES
    ]
    cases += [*texts(*LINES, line + "\t" + parts[0], parts[0], "\n" * 1000), Case("binary", bytes(range(256)))]
    for name in ("train_image.txt", "train_triplets.txt", "train_triplets_baseline.txt"):
        file = folder / name
        campaign.run(
            cases, file, lambda: (walk_through(DatasetReader(folder)), DatasetReader(folder).chosen_triplets("train"))
        )
        file.unlink()
    campaign.end()


def shard(camera: bytes) -> bytes:
    """A shard of one sample."""
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w") as archive:
        pixels, depth = encoded(PIXELS, "PNG"), encoded(np.full((8, 8), 512, np.uint16), "PNG")
        files = {"camera.json": camera, "image.png": pixels, "source1.png": pixels, "source2.png": pixels}
        for kind, data in (files | {"sparse_depth.png": depth}).items():
            member = tarfile.TarInfo(f"hall/000000.{kind}")
            member.size = len(data)
            archive.addfile(member, io.BytesIO(data))
    return content.getvalue()


def test_shards(campaign):
    camera = {"intrinsics": [[8.0, 0, 4], [0, 8, 4], [0, 0, 1]], "poses": [np.eye(4).tolist()] * 3}
    cases = [Case(case.name, shard(case.content)) for case in (*changed_values(camera), *NO_JSON)]
    whole = shard(json.dumps(camera).encode())
    path = campaign.folder / "train-000000.tar"
    campaign.run(cases, path, lambda: walk_through(Shards(campaign.folder)))
    campaign.run(damaged_bytes(whole, 60), path, lambda: walk_through(Shards(campaign.folder)))
    campaign.end()


def test_maps_of_episodes(campaign):
    folder = campaign.folder / "data" / "hall"
    folder.mkdir(parents=True)
    sequence = SequencePaths(folder)

    def npz(**arrays) -> bytes:
        content = io.BytesIO()
        np.savez_compressed(content, **arrays)
        return content.getvalue()

    good = {"occupancy": np.zeros((4, 4), np.int8), "origin": np.zeros(2), "resolution": np.array(0.05)}
    others = (np.nan, np.inf, -1.0, 0.0, np.zeros(0), np.zeros((2, 2)), np.array("text"), np.array([1, 2, 3]), 1j)
    for name, file, read in (
        ("occupancy", folder / "map.npz", lambda: explored_map(sequence, Camera(8, 8), Robot())),
        ("free", folder / "free_floor.npz", lambda: read_free_floor(sequence)),
    ):
        arrays = {name: good["occupancy"], **{key: good[key] for key in ("origin", "resolution")}}
        cases = [Case(f"{key} is {v}", npz(**(arrays | {key: v}))) for key in arrays for v in others]
        cases += [Case(f"no {key}", npz(**{k: v for k, v in arrays.items() if k != key})) for key in arrays]
        much = io.BytesIO()
        with zipfile.ZipFile(much, "w") as archive:
            archive.writestr(f"{name}.npy", npy("(10000, 20000)", "'<i8'"))
        cases.append(Case("much", much.getvalue()))
        campaign.run([*cases, *damaged_bytes(npz(**arrays), 60)], file, read)
        file.unlink()
    record = folder / "uncertainty.csv"
    lines = (
        "",
        "a,b\n1,2",
        "step,uncertainty\n0,x",
        "step,uncertainty\n0",
        "uncertainty\n" + "9" * 5000,
        "\0",
        "uncertainty\n1e400",
    )
    campaign.run([*texts(*lines), Case("binary", bytes(range(256)))], record, lambda: mean_uncertainty([sequence]))
    campaign.end()


CALIBRATION = "calib_time: x\nP_rect_02: 7 0 6 4 0 7 1 2 0 0 1 0\nP_rect_03: 7 0 6 4 0 7 1 2 0 0 1 0"


def test_kitti(campaign):
    from deux_plugins.readers.kitti import _rectified, _speed

    path = campaign.folder / "calib.txt"
    campaign.run(other_words(CALIBRATION.replace("\n", " \n")), path, lambda: _rectified(path, "image_02"))
    campaign.run(other_words(" ".join(["1"] * 12)), path, lambda: _speed(path))
    assert Kitti is not None
    campaign.end()


@pytest.mark.parametrize("read", [*IMAGES, *DEPTHS, read_intrinsics, read_pose, read_any_intrinsics])
def test_no_files(campaign, special_files, read):
    suffixes = {
        ".png": IMAGES + DEPTHS,
        ".npy": (read_any_depth, read_any_intrinsics),
        ".txt": (read_intrinsics, read_pose),
    }
    for path in special_files(*(suffix for suffix, readers in suffixes.items() if read in readers)):
        campaign.call(path.name[:20], lambda path=path: read(path))
    campaign.end()
