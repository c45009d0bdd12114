"""Whether two readers give a model the same tensors."""

import torch

from deux.contracts import Reader
from deux.data.exported_split import ExportedSplit
from deux.data.triplets import SampleSettings, TripletDataset


def assert_same_tensors(split: ExportedSplit, reader: Reader) -> None:
    """Every sample of the split, whatever the order."""
    settings = SampleSettings(ground_truth=True)
    given = TripletDataset([split.reader], split.name, settings)
    read = TripletDataset([reader], split.name, settings)
    place = {(target.sequence, target.name): number for number, (_, (target, _)) in enumerate(read.triplets)}
    assert len(read) == len(given) == len(place)
    for number, (target, _) in enumerate(split.triplets):
        expected, sample = given[number], read[place[split.sequence(target), target.name]]
        for name, value in vars(expected).items():
            if isinstance(value, torch.Tensor):
                assert torch.equal(vars(sample)[name], value), f"{name} of {target}"
