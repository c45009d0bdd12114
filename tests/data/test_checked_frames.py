"""What a reader gives that breaks its contract is an error that names the reader, the method and the frame."""

import re
from pathlib import Path

import numpy as np
import pytest

from deux.contracts import FrameReference, Reader, Triplet
from deux.data.checked_frames import (
    chosen_triplets_of,
    ground_truth_of,
    image_of,
    intrinsics_of,
    pose_of,
    sparse_depth_of,
    triplets_of,
)
from deux.errors import DeuxError

SHAPE = (6, 10)
A, B = FrameReference("hall", "000001"), FrameReference("hall", "000000")
CAMERA = np.array([[9.0, 0.0, 4.5], [0.0, 9.0, 2.5], [0.0, 0.0, 1.0]])
CHECKED = {
    "image": image_of,
    "sparse_depth": sparse_depth_of,
    "ground_truth": ground_truth_of,
    "intrinsics": intrinsics_of,
    "pose": pose_of,
}


class Settable(Reader):
    """Gives what its attributes say, whatever the frame."""

    def __init__(self, **values: object) -> None:
        self.folder = Path("videos")
        self.values: dict[str, object] = {
            "triplets": [Triplet(A, (B,))],
            "chosen_triplets": None,
            "image": np.zeros((*SHAPE, 3), np.uint8),
            "sparse_depth": np.ones(SHAPE, np.float32),
            "ground_truth": None,
            "intrinsics": CAMERA,
            "pose": None,
        } | values

    def triplets(self, split: str, offsets: tuple[int, ...]) -> list[Triplet]:
        return self.values["triplets"]  # type: ignore[return-value]

    def chosen_triplets(self, split: str) -> list[Triplet] | None:
        return self.values["chosen_triplets"]  # type: ignore[return-value]

    def image(self, frame: FrameReference) -> np.ndarray:
        return self.values["image"]  # type: ignore[return-value]

    def intrinsics(self, frame: FrameReference) -> np.ndarray:
        return self.values["intrinsics"]  # type: ignore[return-value]

    def sparse_depth(self, frame: FrameReference) -> np.ndarray:
        return self.values["sparse_depth"]  # type: ignore[return-value]

    def ground_truth(self, frame: FrameReference) -> np.ndarray | None:
        return self.values["ground_truth"]  # type: ignore[return-value]

    def pose(self, frame: FrameReference) -> np.ndarray | None:
        return self.values["pose"]  # type: ignore[return-value]


def with_value(array: np.ndarray, value: float) -> np.ndarray:
    """A copy with another first element."""
    array = array.copy()
    array.flat[0] = value
    return array


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("image", np.zeros((*SHAPE, 3), np.uint8)),
        ("sparse_depth", np.zeros(SHAPE, np.float32)),
        ("ground_truth", np.ones(SHAPE, np.float32)),
        ("ground_truth", None),
        ("intrinsics", CAMERA),
        ("pose", np.eye(4)),
        ("pose", None),
    ],
)
def test_what_the_contract_allows_is_returned_as_it_is(kind: str, value: object) -> None:
    assert CHECKED[kind](Settable(**{kind: value}), A) is value


@pytest.mark.parametrize(
    ("kind", "value", "given", "wanted"),
    [
        ("image", np.zeros(SHAPE, np.uint8), "ndarray of 6 x 10, uint8", "an array of H x W x 3, uint8"),
        ("image", np.zeros((*SHAPE, 3)), "ndarray of 6 x 10 x 3, float64", "an array of H x W x 3, uint8"),
        ("image", np.zeros((*SHAPE, 4), np.uint8), "ndarray of 6 x 10 x 4, uint8", "an array of H x W x 3, uint8"),
        ("sparse_depth", np.ones(SHAPE), "ndarray of 6 x 10, float64", "an array of H x W, float32, in metres"),
        ("sparse_depth", np.ones((*SHAPE, 1), np.float32), "ndarray of 6 x 10 x 1, float32", "an array of H x W, "),
        ("sparse_depth", None, "None", "an array of H x W, float32, in metres"),
        ("sparse_depth", -np.ones(SHAPE, np.float32), "depth from -1 to 0 m", "finite and 0 where there is none"),
        ("ground_truth", [[1.0]], "a value of the type list", "an array of H x W, float32, in metres"),
        ("ground_truth", with_value(np.ones(SHAPE, np.float32), np.nan), "depth from nan to nan m", "finite and 0"),
        ("ground_truth", with_value(np.ones(SHAPE, np.float32), np.inf), "depth from 0 to inf m", "finite and 0"),
        ("intrinsics", np.eye(4), "ndarray of 4 x 4, float64", "an array of 3 x 3, float64"),
        ("intrinsics", None, "None", "an array of 3 x 3, float64"),
        ("intrinsics", CAMERA.astype(np.float32), "ndarray of 3 x 3, float32", "an array of 3 x 3, float64"),
        ("pose", np.eye(4)[:3], "ndarray of 3 x 4, float64", "an array of 4 x 4, float64"),
        ("pose", np.eye(4).tolist(), "a value of the type list", "an array of 4 x 4, float64"),
    ],
)
def test_another_array_is_refused(kind: str, value: object, given: str, wanted: str) -> None:
    sentence = f"^the `{kind}` of the reader Settable gives {given} for frame 000001 of hall in videos: it must be "
    with pytest.raises(DeuxError, match=sentence + wanted):
        CHECKED[kind](Settable(**{kind: value}), A)


@pytest.mark.parametrize(
    ("kind", "value", "sentence"),
    [
        ("intrinsics", np.zeros((3, 3)), "is not the matrix of a pinhole camera"),
        ("intrinsics", with_value(CAMERA, np.nan), "is not a camera matrix: 3 rows of 3 finite numbers"),
        ("intrinsics", with_value(CAMERA, 1e9), r"has the focal lengths 1e\+09 and 9"),
        ("pose", np.diag([2.0, 2.0, 2.0, 1.0]), "is not a pose: its first 3 x 3 numbers are not a rotation"),
        ("pose", np.diag([-1.0, 1.0, 1.0, 1.0]), "are a reflection"),
        ("pose", with_value(np.eye(4), np.nan), "3 or 4 rows of 4 finite numbers"),
        ("pose", 2 * np.eye(4), "its fourth row is not 0 0 0 1"),
    ],
)
def test_cameras_and_poses_are_checked_by_value(kind: str, value: np.ndarray, sentence: str) -> None:
    with pytest.raises(DeuxError, match=f"^the reader Settable: the .* of frame 000001 of hall in videos .*{sentence}"):
        CHECKED[kind](Settable(**{kind: value}), A)


NO_TRIPLETS = {
    "None": None,
    re.escape("(FrameReference(sequence='hall', name='000001'), ("): [(A, (B,))],
    re.escape("Triplet(target=('hall', '000001'), sources="): [Triplet(tuple(A), (B,))],  # type: ignore[arg-type]
    r"Triplet\(.*, sources=\[": [Triplet(A, [B])],  # type: ignore[arg-type]
    r"Triplet\(.*, sources=\('000000',\)": [Triplet(A, ("000000",))],  # type: ignore[arg-type]
}


@pytest.mark.parametrize("given", NO_TRIPLETS)
def test_a_list_of_anything_but_triplets_is_refused(given: str) -> None:
    reader = Settable(triplets=NO_TRIPLETS[given], chosen_triplets=NO_TRIPLETS[given])
    sentence = rf"the reader Settable gives {given}.*: it must be a list of deux\.contracts\.Triplet\("
    with pytest.raises(DeuxError, match=f"^the `triplets` of {sentence}"):
        triplets_of(reader, "train", (-1, -2))
    if NO_TRIPLETS[given] is None:
        assert chosen_triplets_of(reader, "train") is None
    else:
        with pytest.raises(DeuxError, match=f"^the `chosen_triplets` of {sentence}"):
            chosen_triplets_of(reader, "train")


def test_triplets_are_returned_as_they_are() -> None:
    listed = [Triplet(A, (B,))]
    reader = Settable(triplets=listed, chosen_triplets=listed)
    assert triplets_of(reader, "train", (-1,)) is listed
    assert chosen_triplets_of(reader, "train") is listed
