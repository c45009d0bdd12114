import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from deux.bench import render_speed
from deux.bench.__main__ import main
from deux.bench.speed_tables import SpeedTable
from deux.bench.timing import Spread
from deux.errors import DeuxError

THREADS = ["--threads", str(torch.get_num_threads())]
TABLE = SpeedTable(
    "render", "Rendering", ({"renderer": "embree", "frames per second": Spread(2.0, 1.0, 3.0)},), ("A note.",)
)


def test_numbers_go_to_the_screen_and_to_a_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(render_speed, "measure_rendering", lambda settings, scene: iter([TABLE]))
    assert main(["render", "--quick", "--json", str(tmp_path / "numbers.json"), *THREADS]) == 0
    printed = capsys.readouterr().out
    assert "| embree   | 2.00 (1.00 to 3.00) |" in printed
    assert "A note." in printed
    content = json.loads((tmp_path / "numbers.json").read_bytes())
    assert content["machine"]["threads"] == torch.get_num_threads()
    assert content["machine"]["cores"] >= 1
    assert content["tables"] == [
        {
            "name": "render",
            "title": "Rendering",
            "rows": [{"renderer": "embree", "frames per second": {"median": 2.0, "low": 1.0, "high": 3.0}}],
            "notes": ["A note."],
        }
    ]


def test_quick_is_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    monkeypatch.setattr(render_speed, "measure_rendering", lambda settings, scene: asked.append(settings) or iter([]))
    assert main(["render", *THREADS]) == main(["render", "--quick", *THREADS]) == 0
    assert asked == [render_speed.RenderSettings(), render_speed.QUICK]


@pytest.mark.parametrize(
    ("part", "module", "function"),
    [
        ("render", "render_speed", "measure_rendering"),
        ("scenes", "scene_speed", "measure_scenes"),
        ("batching", "batching_speed", "measure_batching"),
        ("explore", "exploration_speed", "measure_exploration_speed"),
        ("environment", "environment_speed", "measure_environment"),
        ("models", "model_speed", "measure_models"),
        ("limits", "step_limits", "measure_limits"),
        ("peers", "peer_figures", "measure_peers"),
        ("processes", "process_speed", "measure_processes"),
        ("published", "published_training", "measure_published_training"),
        ("data", "data_waiting", "measure_data_waiting"),
    ],
)
def test_each_part_runs_alone(part: str, module: str, function: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, ...]] = []
    measuring = importlib.import_module(f"deux.bench.{module}")
    monkeypatch.setattr(measuring, function, lambda *given: asked.append(given) or iter([]))
    assert main([part, "--quick", "--model", "tiny", "--device", "cpu", *THREADS]) == 0
    guided = dict.fromkeys(("batching", "explore", "processes", "data"), ("tiny", "cpu"))
    given = {"render": (None,), "scenes": (), "environment": (), "peers": (None, "cpu"), **guided}.get(part, ("cpu",))
    assert asked == [(measuring.QUICK, *given)]


def test_a_mistake_is_reported_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise DeuxError("there is no such scene.")

    monkeypatch.setattr(render_speed, "measure_rendering", fail)
    assert main(["render", *THREADS]) == 1
    assert capsys.readouterr().err == "deux: there is no such scene.\n"


def test_a_card_that_is_not_there_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert main(["models", "--device", "cuda", *THREADS]) == 1
    assert "--device cuda: PyTorch finds no CUDA device here" in capsys.readouterr().err


def test_help_waits_for_neither_torch_nor_hydra() -> None:
    program = (
        "import runpy, sys\n"
        "sys.argv = ['bench', '--help']\n"
        "try: runpy.run_module('deux.bench', run_name='__main__')\n"
        "except SystemExit: print(sorted({'torch', 'hydra', 'numpy'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert "--quick" in result.stdout
    assert result.stdout.endswith("[]\n")


def test_no_threads_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--threads", "0"])
    assert "'0' is no number of 1 or more" in capsys.readouterr().err
