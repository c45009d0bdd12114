from pathlib import Path

import numpy as np
import pytest
from exported import splits
from PIL import Image

from deux.data.triplet_export import write_triplets


@pytest.fixture
def exported(tmp_path):
    given = splits(tmp_path / "given")
    folder = tmp_path / "export"
    for _ in write_triplets(folder, given, folder):
        pass
    return folder, given


def lines(folder: Path, name: str) -> list[Path]:
    return [Path(line) for line in (folder / name).read_text().splitlines()]


def test_a_training_script_reads_the_lists(exported):
    folder, given = exported
    for split in given:
        named = {
            kind: lines(folder, f"{split.name}_{kind}.txt")
            for kind in ("image", "sparse_depth", "validity_map", "ground_truth", "intrinsics")
        }
        assert {len(paths) for paths in named.values()} == {len(split.triplets)}
        assert all(path.is_absolute() and path.is_file() for paths in named.values() for path in paths)
        for number, (target, sources) in enumerate(split.triplets):
            left, middle, right = np.split(np.array(Image.open(named["image"][number])), 3, axis=1)
            assert np.array_equal(middle, split.reader.image(target))
            assert np.array_equal(left, split.reader.image(sources[0]))
            assert np.array_equal(right, split.reader.image(sources[1]))
            sparse = np.array(Image.open(named["sparse_depth"][number])) / 256.0
            assert np.array_equal(sparse, split.reader.sparse_depth(target))
            assert np.array_equal(np.array(Image.open(named["validity_map"][number])), (sparse > 0) * 256)
            truth = np.array(Image.open(named["ground_truth"][number])) / 256.0
            assert np.array_equal(truth, split.reader.ground_truth(target))
            assert np.array_equal(np.load(named["intrinsics"][number]), split.reader.intrinsics(target))
