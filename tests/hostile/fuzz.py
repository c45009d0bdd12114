"""Coverage-guided fuzzing of every reader of foreign files, by atheris: python tests/hostile/fuzz.py --minutes 60

Each format has a process of its own for an equal share of the time. It starts from good files, changes them, and keeps
a changed file to start from where it reached a branch of deux that no file reached before. A file that leads to
anything else than what it may is kept as <corpus>/failures/<format>_<n>; with any of them the program ends with 1.
Needs `pip install atheris`. Started again with the same --corpus, it goes on from what it kept there.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import Any

import atheris

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS / "hostile"), str(TESTS / "mesh_files")]

# numba compiles bytecode that is not instrumented: in modules with such functions the others are instrumented, below.
COMPILED = [
    ".".join(path.relative_to(TESTS.parent).with_suffix("").parts)
    for path in (TESTS.parent / "deux").rglob("*.py")
    if "@compiled(" in path.read_text()
]

with atheris.instrument_imports(include=["deux", "deux_plugins"], exclude=COMPILED):
    import test_hostile_frames as frames
    import test_hostile_meshes as meshes
    import test_hostile_models as models
    import test_hostile_records as records
    import yaml
    from hostile import judged

    from deux.collection.pipeline import frame_count
    from deux.collection.sparse import SparseSettings
    from deux.collection.verification import VerificationSettings, verify_sequences
    from deux.deployment.model_files import load_model, save_model
    from deux.deployment.published_checkpoints import load_published, save_published
    from deux.figures.training_curves import read_log
    from deux.io.arrays import read_array
    from deux.io.calibration import read_intrinsics, read_pose
    from deux.io.camera_files import read_any_depth, read_any_image
    from deux.io.json_files import read_json
    from deux.io.layout import SequencePaths
    from deux.io.yaml_files import read_yaml
    from deux.registry import registry
    from deux_plugins.readers.parts.trajectory_files import read_trajectory

for module in filter(None, map(sys.modules.get, COMPILED)):
    for function in [value for value in vars(module).values() if isinstance(value, FunctionType)]:
        if function.__module__ == module.__name__:
            atheris.instrument_func(function)

WORDS = (b"0", b"-1", b"1e400", b"nan", b"null", b"true", b"[]", b"{}", b'""', b"\0", b"\xff\xff\xff\xff", b"999999999")
LONGEST = 64 * 1024
"""Bytes of a file."""


@dataclass(frozen=True)
class Format:
    """What is fuzzed.

    Args:
        file: the file that the changed bytes are written to.
        read: reads it.
        good: contents to start from.
    """

    file: Path
    read: Callable[[Path], Any]
    good: list[bytes]


def formats(folder: Path) -> dict[str, Format]:
    """Every format by its name, in a folder of its own."""
    gltf, glb = meshes.document(folder).save("a.gltf").read_bytes(), meshes.document(folder).save("a.glb").read_bytes()
    model = folder / "a.safetensors"
    save_model(model, registry().create("depth_models", "kbnet", models.SMALL), "kbnet", models.SMALL)
    save_published(registry().create("depth_models", "kbnet", models.SMALL), "kbnet", folder / "a.pth")
    published = (folder / "a.pth").read_bytes()
    pictures = [frames.encoded(frames.PIXELS, kind) for kind in ("PNG", "JPEG", "GIF", "TIFF", "WEBP", "BMP")]
    log = folder / "log" / "version_0" / "metrics.csv"
    log.parent.mkdir(parents=True)
    sequence = folder / "sequences" / "hall"
    (sequence / "image").mkdir(parents=True)

    def verify(_: Path) -> None:
        verify_sequences([SequencePaths(sequence)], VerificationSettings(), SparseSettings())

    verify(sequence)
    verdicts = sequence / "verification.json"
    known = {
        "gltf": Format(folder / "case.gltf", meshes.read, [gltf]),
        "glb": Format(folder / "case.glb", meshes.read, [glb]),
        "obj": Format(folder / "case.obj", meshes.read, [meshes.OBJ.replace("mtllib m.mtl\n", "").encode()]),
        "ply": Format(
            folder / "case.ply", meshes.read, [meshes.PLY.replace("comment TextureFile t.png\n", "").encode()]
        ),
        "image": Format(folder / "case.png", read_any_image, pictures),
        "depth": Format(
            folder / "depth.png", read_any_depth, [frames.encoded(frames.PIXELS[..., 0].astype("uint16"), "PNG")]
        ),
        "array": Format(folder / "case.npy", read_array, [frames.npy("(2, 2)")]),
        "intrinsics": Format(folder / "K.txt", read_intrinsics, [b"50 0 32\n0 50 32\n0 0 1\n"]),
        "pose": Format(folder / "pose.txt", read_pose, [b"1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n"]),
        "trajectory": Format(
            folder / "poses.txt",
            lambda path: read_trajectory(path, ["000000", "000001"]),
            [b"0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n", b"1 0 0 1 0 1 0 2 0 0 1 3\n" * 2],
        ),
        "model": Format(folder / "case.safetensors", load_model, [model.read_bytes()]),
        "published": Format(
            folder / "case.pth", lambda path: load_published("kbnet", path, settings=models.SMALL), [published]
        ),
        "json": Format(folder / "case.json", read_json, [b'{"a": [1, 2.5, null], "b": {"c": "d"}}']),
        "yaml": Format(folder / "case.yaml", read_yaml, [b"a: [1, 2.5, null]\nb: {c: d}\n"]),
        "manifest": Format(
            folder / "manifest.json",
            lambda path: [frame_count(path.parent, choice) for choice in ("recent", "baseline")],
            [json.dumps({"triplets": 5, "baseline": {"triplets": 4}}).encode()],
        ),
        "verdicts": Format(verdicts, verify, [verdicts.read_bytes()]),
        "log": Format(log, lambda _: read_log(folder / "log"), [b"step,a\n1,2\n2,1.5\n"]),
    }
    for name, content in (
        ("results.json", records.RESULTS),
        ("run.json", records.IDENTITY),
        ("scorecard.json", records.SCORECARD),
        ("config.yaml", records.IDENTITY),
        ("multirun.yaml", records.SWEEP),
    ):
        run = records.finished_run(folder / f"of_{name}")
        place = {"config.yaml": run / ".hydra", "multirun.yaml": run.parent}.get(name, run)
        if name == "config.yaml":
            (run / "run.json").unlink()
        written = json.dumps(content) if name.endswith("json") else yaml.safe_dump(content)

        def reported(_: Path, folder: Path = folder / f"of_{name}") -> None:
            records.report(folder)

        known[name] = Format(place / name, reported, [written.encode()])
    return known


def changed(content: bytes, longest: int, seed: int) -> bytes:
    """A file with another number, word, cut or repetition, or with whatever libFuzzer's own mutations make of it."""
    draw = random.Random(seed)
    place = draw.randrange(len(content) + 1)
    match draw.randrange(6):
        case 0:
            content = content[:place] + draw.choice(WORDS) + content[place + draw.choice((0, 1, 4)) :]
        case 1:
            content = content[:place]
        case 2:
            end = min(place + draw.randrange(64), len(content))
            content = content[:end] + content[place:end] * draw.randint(1, 3) + content[end:]
        case 3 if numbers := list(re.finditer(rb"-?\d+", content[:20_000])):
            start, end = draw.choice(numbers).span()
            content = content[:start] + draw.choice(WORDS) + content[end:]
        case _:
            content = atheris.Mutate(content, longest)
    return content[:longest]


def fuzz(name: str, corpus: Path, seconds: int, seed: int) -> None:
    """Fuzz one format; the process ends within."""
    folder = Path(tempfile.mkdtemp())
    one = formats(folder)[name]
    kept, failures = corpus / name, corpus / "failures"
    for path in (kept, failures):
        path.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(one.good):
        (kept / f"good_{number}").write_bytes(content)
    causes: set[str] = set()

    def attempt(content: bytes) -> None:
        one.file.write_bytes(content)
        if (problem := judged(lambda: one.read(one.file))) and problem.split("<")[0] not in causes:
            causes.add(problem.split("<")[0])
            path = failures / f"{name}_{len(list(failures.glob(f'{name}_*')))}"
            path.write_bytes(content)
            print(f"{path}: {problem}", flush=True)

    options = [
        f"-max_total_time={seconds}",
        f"-max_len={LONGEST}",
        "-rss_limit_mb=8192",
        "-timeout=120",
        f"-seed={seed}",
    ]
    atheris.Setup([sys.argv[0], str(kept), *options, "-len_control=0"], attempt, custom_mutator=changed)
    atheris.Fuzz()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("formats", nargs="*", help="which; all without")
    parser.add_argument("--minutes", type=float, default=60.0, help="of all formats together")
    parser.add_argument("--corpus", type=Path, default=Path("fuzz_corpus"), help="folder of the files that are kept")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--alone", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.alone:
        fuzz(given.alone, given.corpus, round(60 * given.minutes), given.seed)
    with tempfile.TemporaryDirectory() as folder:
        names = given.formats or list(formats(Path(folder)))
    for name in names:
        command = [
            sys.executable,
            "-W",
            "ignore",
            __file__,
            "--alone",
            name,
            "--minutes",
            str(given.minutes / len(names)),
        ]
        command += ["--corpus", str(given.corpus), "--seed", str(given.seed)]
        ended = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        last = [line for line in ended.stdout.splitlines() if "cov:" in line][-1:]
        found = [line for line in ended.stdout.splitlines() if "/failures/" in line]
        print(
            f"{name}: exit {ended.returncode}, {' '.join(last) or ended.stdout[-2000:]}", *found, sep="\n  ", flush=True
        )
    return 1 if any((given.corpus / "failures").glob("*")) else 0


if __name__ == "__main__":
    sys.exit(main())
