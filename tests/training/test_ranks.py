import json
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from socket import socket

import pytest
from lightning.pytorch import Trainer
from lightning.pytorch.utilities import rank_zero_only

from deux.training import ranks
from deux.training.ranks import decided_by_leader, leads, starts_the_command_again, wait_for_all


def test_a_process_alone_leads_and_waits_for_nobody(monkeypatch):
    assert leads()
    wait_for_all()
    monkeypatch.setattr(rank_zero_only, "rank", 1)
    assert not leads()


def test_lightning_is_imported_only_where_a_launcher_has_started_the_process(tmp_path):
    """With something in Lightning's place that takes no seconds to import, and calls every process the second."""
    utilities = tmp_path / "lightning/pytorch/utilities.py"
    utilities.parent.mkdir(parents=True)
    utilities.write_text("class rank_zero_only:\n    rank = 1\n")
    for package in (utilities.parent, utilities.parents[1]):
        (package / "__init__.py").touch()
    code = (
        f"import os, sys\nsys.path.insert(0, {str(tmp_path)!r})\n"
        "from deux.training.ranks import decided_by_leader, leads\n"
        "print(leads(), 'lightning' in sys.modules)\nassert decided_by_leader(lambda: True)\n"
        "assert 'lightning' not in sys.modules\n"
        "os.environ.update(RANK='1', DEUX_DECISIONS='10')\n"
        "print(leads(), 'lightning' in sys.modules)\nassert not decided_by_leader(lambda: True)\n"
    )
    clean = {name: value for name, value in os.environ.items() if name not in ranks._RANK_VARIABLES}
    result = subprocess.run([sys.executable, "-c", code], env=clean, capture_output=True, text=True, timeout=120)
    assert (result.stdout.split("\n")[:2], result.returncode) == (["True False", "False True"], 0), result.stderr


@pytest.mark.parametrize(
    ("strategy", "devices", "rank", "again"),
    [("auto", 1, None, False), ("ddp", 2, None, True), ("ddp", 2, "0", False)],  # the last: started by torchrun
)
def test_which_trainers_start_the_command_again(monkeypatch, strategy, devices, rank, again):
    monkeypatch.setattr(rank_zero_only, "rank", 0)
    if rank is not None:
        monkeypatch.setenv("LOCAL_RANK", rank)
    trainer = Trainer(strategy=strategy, devices=devices, accelerator="cpu", logger=False, enable_checkpointing=False)
    assert starts_the_command_again(trainer) is again


def test_a_process_alone_decides_for_itself(monkeypatch):
    monkeypatch.setattr(ranks, "_decisions", [])
    monkeypatch.setenv("DEUX_DECISIONS", "11")  # of a run that started this one as a command of its own
    assert [decided_by_leader(lambda answer=answer: answer) for answer in (False, True)] == [False, True]
    assert os.environ["DEUX_DECISIONS"] == "01"


PROGRAM = Path(__file__).with_name("ranked_decisions.py")
LAUNCHERS = {"lightning": ["fit"], "torchrun": [], "slurm": ["fit"]}
"""What starts the two processes, and whether they train."""


def free_port() -> int:
    with closing(socket()) as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def commands(launcher: str, arguments: list[str]) -> list[tuple[list[str], dict[str, str]]]:
    """The commands that start two processes, with their environments; the leading one comes last."""
    launched = ("LOCAL_RANK", "WORLD_SIZE", "RANK", "MASTER_PORT", "MASTER_ADDR", "DEUX_DECISIONS", "NODE_RANK")
    alone = {name: value for name, value in os.environ.items() if name not in launched and "SLURM" not in name}
    if launcher == "torchrun":
        torchrun = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
        return [([sys.executable, *torchrun, *arguments], alone | {"OMP_NUM_THREADS": "1"})]
    if launcher == "lightning":
        return [([sys.executable, *arguments], alone)]
    job = {"NTASKS": "2", "NTASKS_PER_NODE": "2", "NNODES": "1", "NODEID": "0", "NODELIST": "127.0.0.1"}
    job |= {"JOB_NAME": "train", "JOB_ID": "7"}
    slurm = alone | {f"SLURM_{name}": value for name, value in job.items()} | {"MASTER_PORT": str(free_port())}
    ranked = [slurm | {"SLURM_PROCID": rank, "SLURM_LOCALID": rank} for rank in "10"]
    return [([sys.executable, *arguments], environment) for environment in ranked]


@pytest.mark.slow  # test_active_collection.py looks at decisions of two processes, too
@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_two_processes_do_what_the_leading_one_decides(launcher, tmp_path):
    """Before there is a process group, where Lightning starts the second process later, and after it."""
    starting = commands(launcher, [str(PROGRAM), str(tmp_path), *LAUNCHERS[launcher]])
    started = [subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True) for command, env in starting]
    try:
        for process in started:
            _, errors = process.communicate(timeout=200)
            assert process.returncode == 0, errors
    finally:
        for process in started:
            process.kill()
    leading, other = (json.loads((tmp_path / f"{rank}.json").read_text()) for rank in (0, 1))
    decisions = [True, False, False, True, True]
    assert leading == {"told": decisions, "asked": decisions, "leads": True}
    assert other == {"told": decisions, "asked": [], "leads": False}
