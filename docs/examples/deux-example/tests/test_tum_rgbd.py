from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import FrameReference, Reader
from deux.errors import DeuxError
from deux.io.images import write_image
from deux.testing.readers import ReaderSuite, Recordings, record
from deux_example.tum_rgbd import TumRgbd

DENSITY = 0.1


def write_png(path: Path, depth: np.ndarray) -> None:
    """Depth in metres as 16 bits, 5000 values per metre."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.rint(depth * 5000.0).astype(np.uint16))


def write_list(path: Path, lines: list[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in ["# a comment", *lines]))


class TestTumRgbd(ReaderSuite):
    depth_tolerance = 1.01e-4  # half of 1/5000 m

    @pytest.fixture
    def recordings(self) -> Recordings:
        """Two videos of one camera, with the sparse points that are sampled from such images and depth."""
        frames = [
            replace(frame, sparse_depth=sample_sparse(frame.image, frame.ground_truth, SparseSettings(density=DENSITY)))
            for frame in record()["office"]
        ]
        return {"desk": frames, "room": frames[::-1]}

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        for name, frames in recordings.items():
            lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
            for number, frame in enumerate(frames):
                time = 1305031102.175304 + number / 30
                (folder / name / "rgb").mkdir(parents=True, exist_ok=True)
                write_image(folder / name / f"rgb/{time:.6f}.png", frame.image)
                write_png(folder / name / f"depth/{time + 0.004:.6f}.png", frame.ground_truth)
                numbers = [*frame.pose[:3, 3], *Rotation.from_matrix(frame.pose[:3, :3]).as_quat()]
                lists["rgb"].append(f"{time:.6f} rgb/{time:.6f}.png")
                lists["depth"].append(f"{time + 0.004:.6f} depth/{time + 0.004:.6f}.png")
                lists["groundtruth"].append(f"{time - 0.003:.4f} {' '.join(f'{value:.9f}' for value in numbers)}")
            for kind, lines in lists.items():
                write_list(folder / name / f"{kind}.txt", lines)

    def make_reader(self, folder: Path) -> Reader:
        (k,) = {tuple(frame.intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]]) for frame in record()["office"]}
        return TumRgbd(folder, fx=k[0], fy=k[1], cx=k[2], cy=k[3], density=DENSITY)


class TestWithoutPoses(TestTumRgbd):
    has_poses = False

    def write_dataset(self, folder: Path, recordings: Recordings) -> None:
        super().write_dataset(folder, recordings)
        for path in folder.glob("*/groundtruth.txt"):
            path.unlink()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two videos, of which one has four colour images, three depth maps of 1, 2 and 3 m, and two poses."""
    for name in ("desk", "room"):
        (tmp_path / name).mkdir()
        write_list(tmp_path / name / "rgb.txt", [f"{time} rgb/{time}.png" for time in (9.5, 10.0, 10.5, 11.0)])
        write_list(tmp_path / name / "depth.txt", [f"{10.01 + i / 2} depth/{i}.png" for i in range(3)])
        for i in range(3):
            write_png(tmp_path / name / f"depth/{i}.png", np.full((2, 3), i + 1.0))
    write_list(tmp_path / "desk" / "groundtruth.txt", ["10.51 1 2 3 0 0 1 0", "9.99 0 0 0 0 0 0 1"])
    return tmp_path


def test_images_take_the_nearest_depth_and_pose_within_the_tolerance(folder: Path) -> None:
    reader = TumRgbd(folder, tolerance=0.02)
    found = [target for target, _ in reader.triplets("train", ())]
    first, second = (FrameReference("desk", name) for name in ("0000000010.000000", "0000000010.500000"))
    rest = [FrameReference("room", f"00000000{time}0000") for time in ("10.00", "10.50", "11.00")]
    assert found == [first, second, *rest]
    assert [float(np.unique(reader.ground_truth(frame))[0]) for frame in found] == [1.0, 2.0, 1.0, 2.0, 3.0]
    np.testing.assert_array_equal(reader.pose(first), np.eye(4))
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    half_turn[:3, 3] = 1.0, 2.0, 3.0
    pose = reader.pose(second)
    assert pose is not None
    np.testing.assert_allclose(pose, half_turn, atol=1e-12)
    assert reader.pose(rest[0]) is None
    with pytest.raises(DeuxError, match="no train frames"):
        TumRgbd(folder, tolerance=0.001).triplets("train", ())


def test_videos_that_no_split_names_are_for_training(folder: Path) -> None:
    reader = TumRgbd(folder, test=("desk",))
    assert {target.sequence for target, _ in reader.triplets("train", (-1,))} == {"room"}
    assert {target.sequence for target, _ in reader.triplets("test", (-1,))} == {"desk"}
    with pytest.raises(DeuxError, match="did you mean desk"):
        TumRgbd(folder, test=("dsk",))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("10.0 1 2 3 0 0 0 1", "is cut off"),
        ("10.0 1 2 3 0 0 0\n", "a time stamp and 7 more"),
        ("now 1 2 3 0 0 0 1\n", "begin with a time stamp"),
        ("nan 1 2 3 0 0 0 1\n", "begin with a time stamp"),
        ("10.0 1 2 3 0 0 0 0\n", "no translation and quaternion"),
        ("10.0 1 2 3e9 0 0 0 1\n", r"a position of 3e\+09 m"),
    ],
)
def test_a_damaged_list_is_named(folder: Path, content: str, message: str) -> None:
    (folder / "desk" / "groundtruth.txt").write_text(content)
    with pytest.raises(DeuxError, match=rf"groundtruth\.txt .*{message}"):
        TumRgbd(folder).triplets("train", ())
