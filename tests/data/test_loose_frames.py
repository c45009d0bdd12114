"""Images or a video beside a folder of points: which file belongs to which frame, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deux.data.loose_frames import LooseFrames
from deux.errors import DeuxError
from deux.io.images import write_depth
from deux.io.video_files import VideoWriter

HEIGHT, WIDTH = 24, 32


def image(number: int) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), 30 * number + 20, np.uint8)


def points(number: int) -> np.ndarray:
    depth = np.zeros((HEIGHT, WIDTH), np.float32)
    depth[number, number] = 1.0 + number
    return depth


def write(folder: Path, names: list[str], numbers: list[int], video: bool = False) -> LooseFrames:
    """Five images, and points of these names that hold these numbers."""
    (folder / "images").mkdir()
    (folder / "points").mkdir()
    if video:
        with VideoWriter(folder / "clip.mp4") as clip:
            for number in range(5):
                clip.write(image(number))
    else:
        for number in range(5):
            Image.fromarray(image(number)).save(folder / "images" / f"rgb_{number + 8}.png")
    for name, number in zip(names, numbers, strict=True):
        path = folder / "points" / name
        if path.suffix == ".npy":
            np.save(path, points(number))
        else:
            write_depth(path, points(number))
    np.savetxt(folder / "K.txt", np.diag([20.0, 21.0, 1.0]))
    return LooseFrames(folder / ("clip.mp4" if video else "images"), folder / "points", folder / "K.txt")


def test_images_without_points_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write(tmp_path, [f"rgb_{number + 8}.png" for number in (0, 2, 3)], [0, 2, 3])
    assert [record.getMessage() for record in caplog.records] == [
        f"{tmp_path}/images: 2 of 5 images have no depth, by name or number."
    ]


@pytest.mark.parametrize("form", ["rgb_{}.png", "sparse-{}.npy", "{:04d}.png"])
def test_images_have_the_points_of_their_name_or_number(tmp_path: Path, form: str) -> None:
    reader = write(tmp_path, [form.format(number + 8) for number in (0, 2, 3)], [0, 2, 3])
    frames = reader.frames()
    assert [(frame.sequence, frame.name) for frame in frames] == [
        ("images", "rgb_8"),
        ("images", "rgb_10"),
        ("images", "rgb_11"),
    ]
    for frame, number in zip(frames, (0, 2, 3), strict=True):
        np.testing.assert_array_equal(reader.image(frame), image(number))
        np.testing.assert_array_equal(reader.sparse_depth(frame), points(number))
        np.testing.assert_array_equal(reader.intrinsics(frame), np.diag([20.0, 21.0, 1.0]))
        assert reader.ground_truth(frame) is None
        assert reader.pose(frame) is None


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["a1.png", "a2.png", "a3.png", "a4.png", "a5.png"], [0, 1, 2, 3, 4]),  # as many as frames: in their order
        (["cam0_frame_01.png", "cam0_frame_03.png"], [1, 3]),  # by the last number, from 0
    ],
)
def test_frames_of_a_video_have_points_in_order_or_by_number(
    tmp_path: Path, names: list[str], numbers: list[int]
) -> None:
    reader = write(tmp_path, names, numbers, video=True)
    frames = reader.frames()
    assert [int(frame.name) for frame in frames] == numbers
    for frame, number in zip(frames, numbers, strict=True):
        assert abs(int(reader.image(frame).mean()) - int(image(number).mean())) <= 8
        np.testing.assert_array_equal(reader.sparse_depth(frame), points(number))


def test_points_whose_last_numbers_are_equal_belong_to_no_frame_of_a_video(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"points has no sparse depth of the frames of the video .*clip\.mp4"):
        write(tmp_path, ["left_1.png", "right_1.png"], [1, 2], video=True)


def test_ground_truth_has_a_folder_and_a_scale_of_its_own(tmp_path: Path) -> None:
    write(tmp_path, ["rgb_8.png"], [0])
    (tmp_path / "truth").mkdir()
    Image.fromarray(np.full((HEIGHT, WIDTH), 2500, np.uint16)).save(tmp_path / "truth" / "8.png")
    places = (tmp_path / "images", tmp_path / "points", tmp_path / "K.txt")
    reader = LooseFrames(*places, truth=tmp_path / "truth", truth_scale=1000.0)
    assert reader.ground_truth(reader.frames()[0])[0, 0] == 2.5
    assert reader.triplets("test", (-1,)) == [(reader.frames()[0], ())]
    with pytest.raises(DeuxError, match="has no train split"):
        reader.triplets("train", (-1,))


def test_what_is_missing_is_reported(tmp_path: Path) -> None:
    with pytest.raises(
        DeuxError, match=r"points has no sparse depth of the images .*images: a \.png or \.npy file with the name"
    ):
        write(tmp_path, ["other_3.png"], [0])
    (tmp_path / "empty").mkdir()
    with pytest.raises(DeuxError, match=r"empty contains no images: \.png, \.jpg"):
        LooseFrames(tmp_path / "empty", tmp_path / "points", tmp_path / "K.txt")
    with pytest.raises(DeuxError, match=r"none is not a folder: give the folder with one depth map for each frame"):
        LooseFrames(tmp_path / "images", tmp_path / "none", tmp_path / "K.txt")
    with pytest.raises(DeuxError, match=r"K\.txt is neither a folder of images nor a video"):
        LooseFrames(tmp_path / "K.txt", tmp_path / "points", tmp_path / "K.txt")
