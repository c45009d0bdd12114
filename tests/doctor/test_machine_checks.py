"""What the doctor says of the machine and of the folders that deux writes into."""

import os
import shutil

import pytest
import torch

from deux.configuration import compose
from deux.doctor import machine_checks
from deux.doctor.checkup import Checkup
from deux.doctor.machine_checks import check_accelerator, check_folders, check_machine, write_obstacle


def facts(checkup: Checkup) -> dict[str, str]:
    return {name: value for section in checkup.as_json()["sections"] for name, value in section["facts"]}


def test_the_machine_is_described():
    checkup = Checkup(show=False)
    check_machine(checkup)
    assert checkup.faults == 0
    assert facts(checkup)["threads"].startswith(f"{torch.get_num_threads()} of torch")
    assert facts(checkup)["processor"].startswith(f"{len(os.sched_getaffinity(0))} cores")
    assert float(facts(checkup)["free memory"].split()[0]) > 0


def test_an_output_folder_that_is_not_there_yet_can_be_written(tmp_path):
    checkup = Checkup(show=False)
    check_folders(checkup, compose([f"paths.outputs={tmp_path}/a/b"]))
    assert checkup.faults == 0
    assert not (tmp_path / "a").exists(), "nothing is made"
    assert facts(checkup)["outputs"].startswith(f"{tmp_path}/a/b, ")


def test_an_output_folder_that_cannot_be_written_is_a_fault(tmp_path):
    (tmp_path / "file").touch()
    checkup = Checkup(show=False)
    check_folders(checkup, compose([f"paths.outputs={tmp_path}/file/outputs"]))
    assert checkup.faults == 1
    assert write_obstacle(tmp_path / "file" / "outputs") == f"{tmp_path}/file is a file"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_reported(tmp_path):
    tmp_path.chmod(0o500)
    assert write_obstacle(tmp_path) == "Permission denied"


def test_a_full_disk_is_a_fault(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=2**20)
    monkeypatch.setattr(machine_checks.shutil, "disk_usage", lambda path: usage)
    checkup = Checkup(show=False)
    check_folders(checkup, compose([f"paths.outputs={tmp_path}"]))
    assert checkup.faults == 1


def test_a_card_that_is_asked_for_must_be_there(monkeypatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    for overrides, faults in (
        ([], 0),
        (["trainer.accelerator=gpu"], 0),
        (["trainer.accelerator=gpu", "trainer.devices=2"], 1),
    ):
        checkup = Checkup(show=False)
        check_accelerator(checkup, compose(overrides))
        assert checkup.faults == faults, overrides
