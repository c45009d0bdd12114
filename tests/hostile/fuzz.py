"""Reads damaged files for as long as one likes: python tests/hostile/fuzz.py <minutes> [seed]

Starts from one good file of each format, changes it at random, several changes deep, and keeps a changed file to
start from where it led to a sentence that was not seen before: what a coverage-guided fuzzer does by branches. Ends
with 1 if a file led to anything else than what it may, and keeps such files in the working folder as fuzz_<n>.<suffix>.
"""

import random
import re
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "mesh_files"))

import test_hostile_frames as frames
import test_hostile_meshes as meshes
import test_hostile_models as models
from hostile import judged

from deux.deployment.model_files import load_model, save_model
from deux.errors import DeuxError
from deux.io.arrays import read_array
from deux.io.camera_files import read_any_image
from deux.io.json_files import read_json
from deux.io.torch_files import read_torch
from deux.io.yaml_files import read_yaml
from deux.registry import registry

WORDS = (b"0", b"-1", b"1e400", b"nan", b"null", b"true", b"[]", b"{}", b'""', b"\0", b"\xff\xff\xff\xff", b"999999999")


@dataclass
class Format:
    """A format, its reader, and files to start from."""

    suffix: str
    read: Callable[[Path], Any]
    corpus: list[bytes]
    seen: set[str] = field(default_factory=set)


def changed(content: bytes, draw: random.Random) -> bytes:
    """A file with one to four changes: bytes, words, cuts and repetitions."""
    for _ in range(draw.randint(1, 4)):
        place = draw.randrange(len(content) + 1)
        match draw.randrange(5):
            case 0:
                content = content[:place] + draw.randbytes(draw.choice((1, 1, 4))) + content[place + 1 :]
            case 1:
                content = content[:place] + draw.choice(WORDS) + content[place + draw.choice((0, 1, 4)) :]
            case 2:
                content = content[:place]
            case 3:
                end = min(place + draw.randrange(64), len(content))
                content = content[:end] + content[place:end] * draw.randint(1, 3) + content[end:]
            case _:
                numbers = list(re.finditer(rb"-?\d+", content[:20_000]))
                if numbers:
                    start, end = draw.choice(numbers).span()
                    content = content[:start] + draw.choice(WORDS) + content[end:]
    return content


def formats(folder: Path) -> list[Format]:
    """All formats, each with a good file."""
    gltf, glb = meshes.document(folder).save("a.gltf").read_bytes(), meshes.document(folder).save("a.glb").read_bytes()
    model = folder / "a.safetensors"
    save_model(model, registry().create("depth_models", "kbnet", models.SMALL), "kbnet", models.SMALL)
    pictures = [frames.encoded(frames.PIXELS, kind) for kind in ("PNG", "JPEG", "GIF", "TIFF", "WEBP", "BMP")]
    return [
        Format(".gltf", meshes.read, [gltf]),
        Format(".glb", meshes.read, [glb]),
        Format(".obj", meshes.read, [meshes.OBJ.replace("mtllib m.mtl\n", "").encode()]),
        Format(".ply", meshes.read, [meshes.PLY.replace("comment TextureFile t.png\n", "").encode()]),
        Format(".png", read_any_image, pictures),
        Format(".npy", read_array, [frames.npy("(2, 2)")]),
        Format(".safetensors", load_model, [model.read_bytes()]),
        Format(".pt", read_torch, [models.saved({"a": models.torch.zeros(3), "b": [1]})]),
        Format(".json", read_json, [b'{"a": [1, 2.5, null], "b": {"c": "d"}}']),
        Format(".yaml", read_yaml, [b"a: [1, 2.5, null]\nb: {c: d}\n"]),
    ]


def main(minutes: float, seed: int) -> int:
    """Fuzz; the number of failures."""
    draw, end, count, failures = random.Random(seed), time.monotonic() + 60 * minutes, 0, 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        known = formats(folder)
        while time.monotonic() < end:
            one = draw.choice(known)
            content, path = changed(draw.choice(one.corpus), draw), folder / f"case{one.suffix}"
            path.write_bytes(content)
            said = ""

            def read(path: Path = path, one: Format = one) -> None:
                nonlocal said
                try:
                    one.read(path)
                except DeuxError as error:
                    said = re.sub(r"[\d.]+|'[^']*'", "#", str(error))[:120]
                    raise

            problem, count = judged(read), count + 1
            if problem:
                failures += 1
                Path(f"fuzz_{failures}{one.suffix}").write_bytes(content)
                print(f"fuzz_{failures}{one.suffix}: {problem}", flush=True)
            elif said not in one.seen and len(one.corpus) < 500:
                one.seen.add(said)
                one.corpus.append(content)
    print(f"{count:,} files, {failures} failures, {sum(len(one.seen) for one in known)} different sentences")
    return failures


if __name__ == "__main__":
    sys.exit(min(main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0), 1))
