import pytest
from lightning.pytorch import Trainer
from lightning.pytorch.utilities import rank_zero_only

from deux.training.ranks import leads, starts_the_command_again, wait_for_all


def test_a_process_alone_leads_and_waits_for_nobody(monkeypatch):
    assert leads()
    wait_for_all()
    monkeypatch.setattr(rank_zero_only, "rank", 1)
    assert not leads()


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
