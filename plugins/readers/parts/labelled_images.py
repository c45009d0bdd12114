"""The labelled images of NYU Depth V2 in the published MATLAB file."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from deux.errors import DeuxError, shown
from deux.io.file_names import is_file_name

LABELLED = "nyu_depth_v2_labeled.mat"


@dataclass(frozen=True)
class LabelledImages:
    """Reads single images from nyu_depth_v2_labeled.mat, a MATLAB 7.3 (HDF5) file, with h5py.

    MATLAB arrays are column-major: `images` is N x 3 x W x H and `depths` N x W x H in HDF5.

    Args:
        path: the file. splits.mat, the official splits, is expected in the same folder.
    """

    path: Path

    def image(self, number: int) -> np.ndarray:
        """The image with a number, from 1: H x W x 3 uint8."""
        return np.ascontiguousarray(self._read("images", number).transpose(2, 1, 0).astype(np.uint8))

    def depth(self, number: int) -> np.ndarray:
        """The depth of an image, with holes filled by the dataset's authors: H x W float32 metres."""
        return np.ascontiguousarray(self._read("depths", number).T.astype(np.float32))

    @cached_property
    def scenes(self) -> list[str]:
        """The scene of each image, such as kitchen_0004."""
        with self._open() as file:
            try:
                references = np.asarray(file["scenes"]).ravel()
                found = ["".join(map(chr, np.asarray(file[reference]).ravel())) for reference in references]
            except (KeyError, OSError, RuntimeError, TypeError, ValueError, OverflowError) as error:
                raise DeuxError(f"{self.path} does not list the scenes of its images: {error}.") from error
        for scene in found:
            if not is_file_name(scene):  # results are written to folders with these names
                raise DeuxError(f"{self.path} has a scene {shown(scene)}: a name like kitchen_0004 is expected.")
        return found

    def split(self, name: str) -> list[int]:
        """The numbers of the images in a split.

        Args:
            name: "train" or "test".

        Raises:
            DeuxError: splits.mat is missing, damaged or lists images that do not exist.
        """
        path = self.path.with_name("splits.mat")
        if not path.exists():
            raise DeuxError(
                f"{path} is missing: download it (train/test split) from the dataset's page to this folder."
            )
        try:
            numbers = scipy.io.loadmat(path)[f"{name}Ndxs"].ravel()
        except Exception as error:  # a damaged file fails in many ways
            raise DeuxError(f"{path} cannot be read as a MATLAB file with {name}Ndxs: {error}.") from error
        if numbers.min(initial=1) < 1 or numbers.max(initial=1) > len(self.scenes):
            raise DeuxError(f"{path} lists image {numbers.max()}, but {self.path.name} has {len(self.scenes)} images.")
        return [int(number) for number in numbers]

    def _read(self, name: str, number: int) -> np.ndarray:
        with self._open() as file:
            try:
                return np.asarray(file[name][number - 1])
            except (KeyError, OSError, RuntimeError, TypeError, ValueError, IndexError) as error:
                raise DeuxError(f"{self.path} has no {name} of number {number}: {error}.") from error

    def _open(self) -> Any:
        try:
            import h5py
        except ImportError as error:
            raise DeuxError(
                f'reading {self.path} needs h5py, which is not installed: pip install "deux[nyu]".'
            ) from error
        try:
            return h5py.File(self.path, "r")
        except OSError as error:
            raise DeuxError(f"{self.path} is damaged or not a MATLAB 7.3 file: {error}.") from error
