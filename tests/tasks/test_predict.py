"""`task=predict`: a frame's files in, depth files out, in every format that is taken; and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.interpolate import griddata

import deux as package
from deux.io.images import quantise_depth, read_depth, write_depth
from deux.tasks.depth_completion import CompletedDepth
from deux.tasks.frame_prediction import write_prediction

HEIGHT, WIDTH = 45, 61
SECTION = dict.fromkeys(("image", "sparse", "sparse_scale", "intrinsics", "ground_truth", "checkpoint"), "predict.")
"""What the names of the task's own options begin with on the command line."""

FILES = {"depth.png", "depth.npy", "depth_colored.png"}


class Frame:
    """A frame in a folder: image.png, sparse.png (metres x 256) and K.txt. Depths are multiples of 1/8 m."""

    def __init__(self, folder: Path) -> None:
        rng = np.random.default_rng(0)
        rows, columns = np.indices((HEIGHT, WIDTH))
        self.folder = folder
        self.rgb = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
        self.truth = ((rows + columns) // 4 / 8 + 1).astype(np.float32)
        self.sparse = np.where(rng.random(self.truth.shape) < 0.05, self.truth, np.float32(0))
        self.intrinsics = np.array([[30.0, 0.0, 30.0], [0.0, 31.0, 22.0], [0.0, 0.0, 1.0]])
        Image.fromarray(self.rgb).save(folder / "image.png")
        write_depth(folder / "sparse.png", self.sparse)
        np.savetxt(folder / "K.txt", self.intrinsics)

    def save(self, name: str, array: np.ndarray) -> Path:
        """Write an array as .npy, or as PNG or another picture."""
        path = self.folder / name
        if path.suffix == ".npy":
            np.save(path, array)
        else:
            Image.fromarray(array).save(path)
        return path


@pytest.fixture
def frame(tmp_path) -> Frame:
    return Frame(tmp_path)


@pytest.fixture
def predict(deux, frame, model_file, monkeypatch):
    """Run the task on the frame's files, with other options where given, in the frame's folder."""
    monkeypatch.chdir(frame.folder)

    def run(figures=False, **options):
        given = {
            "image": "image.png",
            "sparse": "sparse.png",
            "intrinsics": "K.txt",
            "checkpoint": model_file("kbnet"),
            "hydra.run.dir": frame.folder / "run",
        }
        chosen = {key: value for key, value in (given | options).items() if value is not None}
        arguments = (f"{SECTION.get(key, '')}{key}={value}" for key, value in chosen.items())
        return deux("task=predict", *arguments, figures=figures)

    return run


def written(folder: Path) -> set[str]:
    """What the task wrote into a run folder; Hydra's own files are left out."""
    return {path.name for path in folder.glob("*") if path.name not in (".hydra", "deux.log")}


@pytest.mark.parametrize("model", ["kbnet", "voiced", "scaffnet", "fusionnet"])
def test_the_files_hold_what_the_arrays_give(predict, frame, model_file, model):
    outcome = predict(checkpoint=model_file(model), figures=True)
    assert (outcome.code, outcome.err) == (0, "")
    folder = frame.folder / "run"
    assert written(folder) == FILES
    depth = np.load(folder / "depth.npy", allow_pickle=False)
    expected = package.predict(frame.rgb, frame.sparse, frame.intrinsics, model=model_file(model))
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, expected, rtol=1e-5)  # another number of threads may change the last bits
    np.testing.assert_array_equal(read_depth(folder / "depth.png"), quantise_depth(depth))
    with Image.open(folder / "depth_colored.png") as picture:
        width, height = picture.size
        assert width > height > 300
        assert len(np.unique(np.array(picture.convert("RGB")).reshape(-1, 3), axis=0)) > 100
    *paths, numbers = outcome.out.splitlines()
    assert paths == [str(folder / name) for name in ("depth.png", "depth.npy", "depth_colored.png")]
    assert numbers.startswith(
        f"Depth from {depth.min():.2f} to {depth.max():.2f} m, median {np.median(depth):.2f} m, at"
    )


def test_the_depth_corrected_by_the_points(predict, frame, model_file):
    assert predict(**{"predict.corrected": "true"}).code == 0
    expected = package.predict(frame.rgb, frame.sparse, frame.intrinsics, model=model_file("kbnet"), corrected=True)
    np.testing.assert_allclose(np.load(frame.folder / "run" / "depth.npy"), expected, rtol=1e-5)


def test_a_repeated_command_finds_its_folder_and_overwrites_its_files(predict, frame):
    folders = {"hydra.run.dir": None, "paths.outputs": frame.folder / "outputs"}
    for brightness in (1.0, 0.5):
        frame.save("image.png", (frame.rgb * brightness).astype(np.uint8))
        assert predict(**folders).code == 0
        (folder,) = frame.folder.glob("outputs/runs/*")
        assert re.fullmatch("predict-[0-9a-f]{8}", folder.name)
        assert written(folder) == FILES
        depth = package.predict(
            (frame.rgb * brightness).astype(np.uint8), frame.sparse, frame.intrinsics, model=checkpoint(folder)
        )
        np.testing.assert_allclose(np.load(folder / "depth.npy"), depth, rtol=1e-5)


def checkpoint(folder: Path) -> str:
    """The checkpoint that a run's configuration names."""
    found = re.search(
        "^predict:\n(?:  .*\n)*?  checkpoint: (.*)$", (folder / ".hydra" / "config.yaml").read_text(), re.MULTILINE
    )
    assert found
    return found[1]


def test_a_sweep_completes_several_frames(deux, predict, frame, model_file):
    frame.save("other.png", 255 - frame.rgb)
    folder = {"hydra.run.dir": None, "hydra.sweep.dir": frame.folder / "sweep"}
    given = {"image": "image.png,other.png", "sparse": "sparse.png", "intrinsics": "K.txt"} | folder
    options = [f"{SECTION.get(key, '')}{key}={value}" for key, value in given.items() if value is not None]
    outcome = deux("task=predict", f"predict.checkpoint={model_file('kbnet')}", *options, "-m")
    assert (outcome.code, outcome.err) == (0, "")
    assert len(list(frame.folder.glob("sweep/predict-*/depth.png"))) == 2


@pytest.mark.parametrize("picture", ["a.bmp", "a.tiff", "a.webp", "rgba.png", "palette.png", "grey.png", "black.png"])
def test_pictures_of_all_kinds(predict, frame, model_file, picture):
    rgb, kind = frame.rgb, Path(picture).stem
    image = Image.fromarray(rgb)
    if kind == "rgba":
        image.putalpha(128)
    elif kind == "palette":
        image = image.quantize(16)
        image.info["transparency"] = bytes([0] * 8 + [255] * 8)
        rgb = np.array(image.convert("RGBA").convert("RGB"))
    elif kind == "grey":
        image = image.convert("L")
        rgb = np.repeat(np.array(image)[..., None], 3, axis=2)
    elif kind == "black":
        image = image.convert("1")
        rgb = np.repeat(255 * np.array(image, np.uint8)[..., None], 3, axis=2)
    image.save(frame.folder / picture, **({"lossless": True} if picture.endswith("webp") else {}))
    outcome = predict(image=picture)
    assert (outcome.code, outcome.err) == (0, "")
    expected = package.predict(rgb, frame.sparse, frame.intrinsics, model=model_file("kbnet"))
    np.testing.assert_allclose(np.load(frame.folder / "run" / "depth.npy"), expected, rtol=1e-5)


@pytest.mark.parametrize("how", ["millimetres", "array", "double array", "intrinsics array", "one line"])
def test_the_same_points_and_camera_in_other_formats(predict, frame, how):
    assert predict(**{"hydra.run.dir": frame.folder / "known"}).code == 0
    if how == "millimetres":
        frame.save("mm.png", np.rint(1000 * frame.sparse).astype(np.uint16))
        outcome = predict(sparse="mm.png", sparse_scale=1000)
    elif how.endswith("array") and how != "intrinsics array":
        frame.save("points.npy", frame.sparse.astype(np.float64 if "double" in how else np.float32))
        outcome = predict(sparse="points.npy")
    elif how == "intrinsics array":
        frame.save("K.npy", frame.intrinsics.astype(np.int64))
        outcome = predict(intrinsics="K.npy")
    else:
        (frame.folder / "line.txt").write_text("30 0 30 0 31 22 0 0 1")
        outcome = predict(intrinsics="line.txt")
    assert (outcome.code, outcome.err) == (0, "")
    known, depth = (np.load(frame.folder / run / "depth.npy") for run in ("known", "run"))
    np.testing.assert_array_equal(depth, known)


@pytest.mark.parametrize("truth", ["truth.png", "truth.npy"])
def test_errors_are_those_of_the_pixels_that_were_not_given(predict, frame, truth):
    known = np.where(frame.sparse > 0, np.float32(1.25) * frame.truth, frame.truth)  # another truth at the points
    known[:5] = 0.0
    if truth.endswith("npy"):
        frame.save(truth, known)
    else:
        write_depth(frame.folder / truth, known)
    outcome = predict(ground_truth=truth)
    assert (outcome.code, outcome.err) == (0, "")
    counted = (known > 0) & (frame.sparse == 0)
    assert f"Errors on the {counted.sum():,} pixels with ground truth" in outcome.out

    grid = tuple(np.indices(known.shape))
    points, values = np.argwhere(frame.sparse > 0), frame.sparse[frame.sparse > 0]
    linear, nearest = (griddata(points, values, grid, method=method) for method in ("linear", "nearest"))
    dense = {
        "kbnet": np.load(frame.folder / "run" / "depth.npy").astype(float),
        "interpolated points": np.where(np.isnan(linear), nearest, linear),
    }
    for name, depth in dense.items():
        difference, inverse = (depth - known)[counted], (1 / depth[counted] - 1 / known[counted])
        expected = [
            f(1000 * x)
            for x in (difference, inverse)
            for f in (lambda e: abs(e).mean(), lambda e: (e**2).mean() ** 0.5)
        ]
        (row,) = (line for line in outcome.out.splitlines() if name in line)
        numbers = [float(number) for number in re.findall(r"[\d.]+", row)]
        # Four points on a circle are joined in two ways, which depends on the release of SciPy.
        assert numbers == pytest.approx(expected, rel=0.01 if name == "kbnet" else 0.03, abs=0.1)


def test_a_published_checkpoint_completes_a_frame(predict, frame, model_file):
    model = package.load(model_file("kbnet"))
    published = {group: module.state_dict() for group, module in model.published_modules().items()}
    torch.save(published, frame.folder / "published.pth")
    options = {"image_filters": "[4,8,8,8,8]", "depth_filters": "[4,4,4,4,4]", "decoder_filters": "[8,8,8,8,4]"}
    options = {f"model.{name}": value for name, value in options.items()}
    outcome = predict(checkpoint="published.pth", **options)
    assert outcome.code == 0
    assert outcome.err.startswith("WARNING: ")
    assert outcome.err.count("\n") == 1
    assert "published.pth does not contain the depth range of its training" in outcome.err
    near, far = {"hydra.run.dir": frame.folder / "near"}, {"hydra.run.dir": frame.folder / "far"}
    named = [predict(checkpoint="published.pth", **options, **near, **{"model.max_depth": 8})]
    named.append(predict(checkpoint="published.pth", **options, **far, **{"model.max_depth": 10}))
    assert [(outcome.code, outcome.err) for outcome in named] == [(0, "")] * 2
    depths = [np.load(frame.folder / run / "depth.npy") for run in ("run", "far", "near")]
    np.testing.assert_array_equal(depths[0], depths[1])
    assert (depths[2] < depths[1]).all()
    expected = package.predict(frame.rgb, frame.sparse, frame.intrinsics, model=model)
    np.testing.assert_allclose(np.load(frame.folder / "run" / "depth.npy"), expected, rtol=1e-5)


def test_scenes_and_explorer_play_no_part(predict):
    assert predict(**{"scenes": "files", "explore": "random"}).code == 0


# ------------------------------------------------------------------------------------------------------- warnings


def change(frame: Frame, kind: str) -> dict[str, object]:
    """Spoil the frame's files; the options that go with it."""
    if kind == "no points":
        write_depth(frame.folder / "sparse.png", np.zeros((HEIGHT, WIDTH)))
    elif kind == "some far points":
        write_depth(frame.folder / "sparse.png", np.where(frame.truth > 2.5, 5, 1) * frame.sparse)
    elif kind == "all far points":
        write_depth(frame.folder / "sparse.png", 11 * frame.sparse)
    elif kind == "too small a scale":
        return {"sparse_scale": 1}
    elif kind == "other camera":
        np.savetxt(frame.folder / "K.txt", frame.intrinsics * [[4.0], [4.0], [1.0]])
    elif kind == "smaller camera":
        np.savetxt(frame.folder / "K.txt", frame.intrinsics * [[0.5], [0.5], [1.0]])
    elif kind == "normalised camera":
        np.savetxt(frame.folder / "K.txt", frame.intrinsics / [[WIDTH], [HEIGHT], [1.0]])
    elif kind == "millimetres":  # of a small scene, which stays within the model's range
        frame.save("sparse.png", np.rint(550 * frame.sparse).astype(np.uint16))
    elif kind == "truth in another unit":
        write_depth(frame.folder / "truth.png", 1.5 * frame.truth)
        return {"ground_truth": "truth.png"}
    elif kind == "other sizes":
        frame.save("image.png", frame.rgb[:, 1:])
    elif kind == "other size of the truth":
        write_depth(frame.folder / "truth.png", frame.truth[1:])
        return {"ground_truth": "truth.png"}
    elif kind == "no truth":
        write_depth(frame.folder / "truth.png", frame.sparse)
        return {"ground_truth": "truth.png"}
    return {}


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        (
            "no points",
            "WARNING: sparse.png has no sparse point, all its values are 0: only the image is used.",
        ),
        (
            "some far points",
            "% of the [0-9]+ points of sparse.png are out of the model's depth range of 0.1 to 10 m ",
        ),
        (
            "other camera",
            r"WARNING: the principal point \(120, 88\) is outside of the image of 61 x 45 pixels: .*/K.txt",
        ),
        ("smaller camera", r"WARNING: the principal point \(15, 11\) is far from the centre .* about 31 x 23 pixels"),
        (
            "normalised camera",
            r"too short .*: if .*/K.txt is normalised by .* first row by the width 61 and its second row by the height",
        ),
        (
            "millimetres",
            r"the median depth of sparse.png is 5\.\d+ m with predict.sparse_scale=256 and would be 1\.\d+ m with "
            r"predict.sparse_scale=1000 \(millimetres\)",
        ),
        (
            "truth in another unit",
            r"WARNING: truth.png is 1.5 times the sparse depth at the points .*: are both in one unit\? "
            "predict.ground_truth_scale sets",
        ),
    ],
)
def test_what_is_suspicious_is_reported(predict, frame, kind, sentence):
    outcome = predict(**change(frame, kind))
    assert outcome.code == 0
    assert outcome.err.startswith("WARNING: ")
    assert outcome.err.count("\n") == 1
    assert re.search(sentence, outcome.err)
    assert written(frame.folder / "run") == FILES


def test_ground_truth_may_have_a_scale_of_its_own(predict, frame):
    frame.save("mm.png", np.rint(1000 * frame.sparse).astype(np.uint16))
    write_depth(frame.folder / "truth.png", frame.truth)
    known = predict(ground_truth="truth.png")
    scales = {"sparse_scale": 1000, "predict.ground_truth_scale": 256}
    outcome = predict(sparse="mm.png", ground_truth="truth.png", **scales)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out == known.out
    assert predict(ground_truth="truth.png", **{"predict.ground_truth_scale": 0}).sentence == (
        "predict.ground_truth_scale is 0.0: it must be above 0."
    )


def test_without_points_nothing_is_interpolated(predict, frame):
    write_depth(frame.folder / "truth.png", frame.truth)
    outcome = predict(ground_truth="truth.png", **change(frame, "no points"))
    assert outcome.code == 0
    assert f"Errors on the {frame.truth.size:,} pixels" in outcome.out
    assert "interpolated points" not in outcome.out


def test_depth_beyond_what_a_png_holds_is_reported(tmp_path, caplog):
    depth = np.array([[1.0, 300.0]], np.float32)
    png, npy, _ = write_prediction(CompletedDepth(depth), tmp_path / "run")
    assert caplog.messages == [f"{png} is 0 where the depth is above 256 m: {npy} contains these depths as well."]
    np.testing.assert_array_equal(read_depth(png), [[1.0, 0.0]])
    np.testing.assert_array_equal(np.load(npy), depth)


# ------------------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("all far points", r"all \d+ points of sparse.png are out of the model's depth range of 0.1 to 10 m"),
        (
            "too small a scale",
            r"all \d+ points of sparse.png .* have predict.sparse_scale=1 values per metre, which is 1000 for",
        ),
        ("other sizes", "predict.image has 60 x 45 pixels and predict.sparse 61 x 45: they must have the same size."),
        (
            "other size of the truth",
            "predict.image has 61 x 45 pixels and predict.ground_truth 61 x 44: they must have the same size.",
        ),
        (
            "no truth",
            "predict.ground_truth=.* has no pixel between 0.1 and 10 m apart from the sparse points: give another file",
        ),
    ],
)
def test_files_that_do_not_fit_together(predict, frame, kind, sentence):
    assert re.match(sentence, predict(**change(frame, kind)).sentence)
    assert written(frame.folder / "run") == set()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            {"image": None},
            "task=predict needs the files of one frame, predict.image=, predict.sparse= and predict.intrinsics=, or ",
        ),
        (
            {"sparse": None, "intrinsics": None},
            "task=predict needs the files .*: sparse and intrinsics are not given.$",
        ),
        ({"checkpoint": None}, "a trained model is needed: set predict.checkpoint= to a run folder, .* checkpoint.$"),
        ({"checkpoint": "."}, "there is no model .*/model.safetensors: give a model file, a run folder"),
        ({"image": "nothing.png"}, ".*/nothing.png is missing.$"),
        ({"image": "K.txt"}, ".*/K.txt cannot be read as an image, .*: Pillow does not support its format.$"),
        (
            {"image": "."},
            r"predict\.image=\. is a folder, and the file of one frame .* use predict\.data= for a folder of frames\.$",
        ),
        ({"image": "sparse.png"}, ".*/sparse.png is an image of mode I;16: 8 bits per channel are expected"),
        ({"sparse": "image.png"}, ".*/image.png is an image of mode RGB where a 16-bit depth map is expected."),
        (
            {"sparse": "K.txt"},
            r".*/K.txt is not a PNG file \(.* bytes\): a 16-bit depth map in PNG format is expected.",
        ),
        ({"intrinsics": "nothing.npy"}, ".*/nothing.npy is missing.$"),
        ({"intrinsics": "image.png"}, ".*/image.png is not a text file of numbers.$"),
        ({"ground_truth": "nothing.png"}, ".*/nothing.png is missing.$"),
        ({"sparse_scale": "0"}, "predict.sparse_scale is 0.0: it must be above 0.$"),
        ({"sparse_scale": "inch"}, "predict.sparse_scale must be a number, but is 'inch'.$"),
        (
            {"predict.sparse.density": "0.1"},
            "there is no option predict.sparse.density: predict.sparse is a single value",
        ),
    ],
)
def test_an_option_that_cannot_be(predict, frame, options, sentence):
    assert re.match(sentence, predict(**options).sentence)
    assert written(frame.folder / "run") == set()


def spoilt(frame: Frame, kind: str) -> dict[str, str]:
    """A damaged or foreign file, as the option that names it."""
    folder = frame.folder
    image, points = (folder / "image.png").read_bytes(), (folder / "sparse.png").read_bytes()
    text = {"singular": "0 0 0 0 0 0 0 0 1", "matrix": "1 2 3 4", "words": "fx fy cx cy"}
    arrays = {
        "integers": np.rint(1000 * frame.sparse).astype(np.uint16),
        "nan": np.where(frame.sparse > 0, frame.sparse, np.nan),
        "negative": -frame.sparse,
        "channel": frame.sparse[..., None],
        "pickle": np.array([{}], dtype=object),
    }
    if kind.startswith("cut "):
        option = kind.removeprefix("cut ")
        content = {"image": image, "sparse": points}[option]
        (folder / "cut.png").write_bytes(content[: len(content) // 2])
        return {option: "cut.png"}
    if kind == "jpeg":
        Image.fromarray(frame.rgb).save(folder / "whole.jpg")
        (folder / "cut.jpg").write_bytes((folder / "whole.jpg").read_bytes()[:1000])
        return {"image": "cut.jpg"}
    if kind == "flipped":
        (folder / "flipped.png").write_bytes(points[:60] + bytes([points[60] ^ 16]) + points[61:])
        return {"sparse": "flipped.png"}
    if kind in text:
        (folder / f"{kind}.txt").write_text(text[kind])
        return {"intrinsics": f"{kind}.txt"}
    if kind == "archive":
        np.savez(folder / "archive.npz", frame.sparse)
        (folder / "archive.npz").rename(folder / "archive.npy")
        return {"sparse": "archive.npy"}
    if kind == "half an array":
        np.save(folder / "whole.npy", frame.sparse)
        (folder / "cut.npy").write_bytes((folder / "whole.npy").read_bytes()[:500])
        return {"sparse": "cut.npy"}
    if kind == "K":
        np.save(folder / "K.npy", np.eye(4))
        return {"intrinsics": "K.npy"}
    np.save(folder / f"{kind}.npy", arrays[kind], allow_pickle=True)
    return {"sparse": f"{kind}.npy"}


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("cut image", "cut.png is truncated ("),
        ("jpeg", "cut.jpg cannot be read as an image, it is damaged or not an image: "),
        ("cut sparse", "cut.png is truncated ("),
        ("flipped", "flipped.png is damaged"),
        ("singular", "singular.txt is not the matrix of a pinhole camera"),
        ("matrix", "matrix.txt is not a camera matrix: 3 rows of 3 finite numbers are expected."),
        ("words", "words.txt is not a text file of numbers."),
        ("K", "K.npy is not a camera matrix: 3 rows of 3 finite numbers are expected."),
        ("integers", "integers.npy contains numbers of the type uint16: a .npy file must contain metres as floats."),
        ("nan", "nan.npy contains negative or infinite numbers or NaN: depth must be in metres, 0 for none."),
        ("negative", "negative.npy contains negative or infinite numbers or NaN"),
        ("channel", "channel.npy has the shape 45 x 61 x 1: a depth map must be H x W."),
        ("pickle", "pickle.npy contains values of the type 'object' where numbers are expected"),
        ("archive", "archive.npy is damaged or not a .npy file of numbers: the magic string is not correct"),
        ("half an array", "cut.npy is damaged: its shape (45, 61) of float32 needs 10980 bytes"),
    ],
)
def test_a_damaged_file_is_named(predict, frame, kind, sentence):
    assert predict(**spoilt(frame, kind)).sentence.startswith(f"{frame.folder}/{sentence}")
    assert written(frame.folder / "run") == set()


def test_a_model_that_brings_its_weights_needs_no_checkpoint(predict, frame, wall):
    outcome = predict(checkpoint=None, model=wall, **{"model.distance": 3.5})
    assert (outcome.code, outcome.err) == (0, "")
    assert (np.load(frame.folder / "run" / "depth.npy") == 3.5).all()
    assert "a trained model is needed" in predict(checkpoint=None, model="kbnet").sentence
