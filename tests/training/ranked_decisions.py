"""A command that several processes run, each of which finds something else: see `test_ranks.py`.

    python ranked_decisions.py FOLDER [fit]

Each process writes what it was told to FOLDER/<rank>.json. With "fit", Lightning starts the second process.
"""

import json
import os
import sys
import time
from pathlib import Path

import torch
from lightning.pytorch import LightningModule, Trainer

from deux.training.ranks import decided_by_leader, leads, wait_for_all


class Module(LightningModule):
    def __init__(self) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(1, 1)

    def training_step(self, batch: torch.Tensor) -> torch.Tensor:
        return self.layer(batch).mean()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.1)

    def train_dataloader(self) -> torch.utils.data.DataLoader:
        return torch.utils.data.DataLoader(torch.ones(4, 1))


def fit() -> None:
    quiet = {"logger": False, "enable_progress_bar": False, "enable_model_summary": False}
    trainer = Trainer(accelerator="cpu", devices=2, strategy="ddp", max_steps=1, enable_checkpointing=False, **quiet)
    trainer.fit(Module())


def main(folder: Path, train: bool) -> None:
    torch.set_num_threads(1)
    asked = []

    def decide(answer: bool) -> bool:
        """What the leader answers; any other process would say the opposite, and must not be asked."""
        asked.append(answer)
        return answer if leads() else not answer

    told = [decided_by_leader(lambda: decide(True)), decided_by_leader(lambda: decide(False))]
    if train:
        fit()
    time.sleep(0.3 if leads() else 0.0)  # the others have to wait
    told += [decided_by_leader(lambda: decide(False)), decided_by_leader(lambda: decide(True))]
    if train:
        fit()
    told.append(decided_by_leader(lambda: decide(True)))
    rank = os.environ.get("SLURM_PROCID", os.environ.get("RANK", os.environ.get("LOCAL_RANK", "0")))
    (folder / f"{rank}.json").write_text(json.dumps({"told": told, "asked": asked, "leads": leads()}))
    if train:
        wait_for_all()
    else:
        while len(list(folder.glob("*.json"))) < 2:
            time.sleep(0.05)


if __name__ == "__main__":
    main(Path(sys.argv[1]), "fit" in sys.argv[2:])
