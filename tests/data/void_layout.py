"""Datasets in VOID's layout, written without anything that reads them."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from toy_world import ROOM, ToyScene, ToySimulator

from deux.contracts import Action
from deux.testing.readers import RecordedFrame

KINDS = ("image", "sparse_depth", "ground_truth", "absolute_pose")


def walk(scene: str, frames: int, density: float = 0.05) -> list[RecordedFrame]:
    """A walk through a room with smooth colours, in which a frame can be rebuilt from its neighbours."""
    rng = np.random.default_rng(len(scene))
    simulator = ToySimulator(ToyScene(scene, f"toy-{scene}"))
    simulator.reset(float(ROOM[0, 0] + 1.0), 1.0, -0.6)
    found = []
    for step in range(frames):
        simulator.step((Action.FORWARD, Action.LEFT)[step % 2])
        frame = simulator.observe()
        sparse = np.where(rng.random(frame.depth.shape) < density, frame.depth, 0.0)
        found.append(RecordedFrame(frame.rgb, sparse, frame.depth, simulator.camera.intrinsics, frame.pose))
    return found


def write(
    folder: Path,
    recordings: Mapping[str, Sequence[RecordedFrame]],
    split: str = "train",
    kinds: Sequence[str] = KINDS,
    triplets: bool = False,
    names: str = "{:06d}",
) -> Path:
    """Write all frames as one split, with the release's image list or with our own list of triplets."""
    lines = []
    for sequence, frames in recordings.items():
        base = folder / "data" / sequence
        for kind in kinds:
            (base / kind).mkdir(parents=True)
        np.savetxt(base / "K.txt", frames[0].intrinsics, fmt="%.18e")
        listed = []
        for number, frame in enumerate(frames):
            name = names.format(number)
            Image.fromarray(frame.image).save(base / f"image/{name}.png")
            for kind, depth in (("sparse_depth", frame.sparse_depth), ("ground_truth", frame.ground_truth)):
                if kind in kinds:
                    Image.fromarray(np.rint(depth * 256.0).astype(np.uint16)).save(base / f"{kind}/{name}.png")
            if "absolute_pose" in kinds:
                np.savetxt(base / f"absolute_pose/{name}.txt", frame.pose[:3], fmt="%.18e")
            listed.append(f"{folder.name}/data/{sequence}/image/{name}.png")
        if triplets:
            listed = ["\t".join(reversed(listed[i : i + 3])) for i in range(len(listed) - 2)]
        lines += listed
    (folder / f"{split}_{'triplets' if triplets else 'image'}.txt").write_text("\n".join(lines) + "\n")
    return folder


def dataset(folder: Path, split: str = "train", frames: int = 8, **options: object) -> Path:
    """Twelve triplets of two rooms."""
    recordings = {f"{scene}-00": walk(scene, frames) for scene in ("hall", "kitchen")}
    return write(folder, recordings, split, **({"triplets": True} | options))  # type: ignore[arg-type]


def enlarge(folder: Path, factor: int = 10) -> None:
    """Make the rooms so many times larger, such as streets, and leave their poses out, which would not fit."""
    for kind in ("sparse_depth", "ground_truth"):
        for file in folder.glob(f"data/*/{kind}/*.png"):
            Image.fromarray(factor * np.array(Image.open(file))).save(file)
    for poses in folder.glob("data/*/absolute_pose"):
        shutil.rmtree(poses)
