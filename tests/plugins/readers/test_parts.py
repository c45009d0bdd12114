"""What the readers share: trajectories."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deux.errors import DeuxError
from deux_plugins.readers.parts.trajectory_files import read_trajectory

POSES = [np.eye(4) for _ in range(3)]
for index, pose in enumerate(POSES):
    pose[:3, :3] = Rotation.from_euler("xyz", [0.1 * index, 0.2, 0.3]).as_matrix()
    pose[:3, 3] = 1.0 + index, 2.0, -3.0
STAMPS = ["1305031102.1753", "1305031102.2112", "1305031102.2756"]


def tum_line(time: str, pose: np.ndarray) -> str:
    numbers = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
    return f"{time} {' '.join(f'{number:.12f}' for number in numbers)}\n"


def write_form(form: str, folder: Path) -> Path:
    path = folder / "poses.txt"
    if form == "4 x 4":
        np.savetxt(path, [pose.ravel() for pose in POSES])
    elif form == "3 x 4":
        np.savetxt(path, [pose[:3].ravel() for pose in POSES], delimiter=",")
    elif form == "TUM":
        times = [f"{float(stamp) + 0.004:.4f}" for stamp in STAMPS]
        far = tum_line("1305031102.2400", np.eye(4))
        path.write_text("# timestamp tx ty tz qx qy qz qw\n" + far + "".join(map(tum_line, times, POSES)))
    else:
        path = folder / "poses"
        path.mkdir()
        for stamp, pose in zip(STAMPS, POSES, strict=True):
            np.savetxt(path / f"{stamp}.txt", pose)
    return path


@pytest.mark.parametrize("form", ["4 x 4", "3 x 4", "TUM", "folder"])
def test_trajectories_of_every_form(tmp_path: Path, form: str) -> None:
    path = write_form(form, tmp_path)
    found = read_trajectory(path, STAMPS)
    assert list(found) == STAMPS
    np.testing.assert_allclose(list(found.values()), POSES, atol=1e-9)
    inverted = read_trajectory(path, STAMPS, world_to_camera=True)
    np.testing.assert_allclose([inverted[stamp] for stamp in STAMPS], np.linalg.inv(POSES), atol=1e-9)


def test_frames_whose_tracking_was_lost_have_no_pose(tmp_path: Path) -> None:
    rows = [pose.ravel() for pose in POSES]
    rows[1] = np.full(16, -np.inf)
    np.savetxt(tmp_path / "poses.txt", rows)
    assert list(read_trajectory(tmp_path / "poses.txt", STAMPS)) == [STAMPS[0], STAMPS[2]]
    write_form("folder", tmp_path)
    np.savetxt(tmp_path / "poses" / f"{STAMPS[1]}.txt", np.full((4, 4), np.nan))
    (tmp_path / "poses" / f"{STAMPS[2]}.txt").unlink()
    assert list(read_trajectory(tmp_path / "poses", STAMPS)) == STAMPS[:1]


def test_a_pose_too_far_in_time_belongs_to_no_frame(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text(tum_line("1305031102.2332", POSES[0]))
    assert read_trajectory(tmp_path / "poses.txt", STAMPS) == {}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1 0\n", "has 1 lines for 3 images: one line for each"),
        ("1 2 3\n", "has lines of 3 numbers: a pose must be 12 or 16"),
        ("", "has lines of no numbers"),
        ("a b c d e f g h\n", "is not a text file of numbers"),
        ("1 0 0 0 0 2 0 0 0 0 1 0\n" * 3, f"line of {STAMPS[0]}, .* first 3 x 3 numbers are not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n" * 3, "first 3 x 3 numbers are a reflection"),
        ("1 0 0 2e8 0 1 0 0 0 0 1 0\n" * 3, r"has a position of 2e\+08 m"),
        (f"{STAMPS[0]} 1 2 3 0 0 0 0\n", "quaternion of zero length"),
        (f"{STAMPS[0]} 1 2 -2e8 0 0 0 1\n", rf"line of {STAMPS[0]}, has a position of 2e\+08 m"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(DeuxError, match=said):
        read_trajectory(path, STAMPS)


@pytest.mark.parametrize("form", ["4 x 4", "folder"])
def test_transposed_matrices_are_refused(tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Column by column, as some devices write them, they would be read as turns about the origin."""
    monkeypatch.setattr(f"{__name__}.POSES", [pose.T for pose in POSES])
    path = write_form(form, tmp_path)
    with pytest.raises(DeuxError, match=rf"{STAMPS[0]}.* its fourth row is not 0 0 0 1, so it may be transposed\.$"):
        read_trajectory(path, STAMPS)


def test_poses_by_time_need_images_called_by_time(tmp_path: Path) -> None:
    path = write_form("TUM", tmp_path)
    with pytest.raises(DeuxError, match="the images must be named by time stamp"):
        read_trajectory(path, ["frame_1", "frame_2", "frame_3"])
