"""Which depth image an explorer's map is built from."""

from typing import Literal

import numpy as np

from deux.contracts import Need, Observation
from deux.errors import DeuxError
from deux.mapping.occupancy import EXACT, DepthErrors

DepthSource = Literal["predicted", "sensor"]

PREDICTION = DepthErrors(relative=0.1, border=6)
"""What a briefly trained seed model's depth was measured to be like.

KBNet after 300 steps, 128 x 128 pixels: 90 % of the floor's pixels are off by less than 20 %, but the outermost rows
and columns are predicted at 0.25 to 0.8 of the true depth. With them in the map a ring of false obstacles half a
metre from the robot imprisons it.
"""


def depth_need(source: DepthSource, option: str) -> Need:
    """What to declare for a depth source; `option` names it in the error for an unknown one."""
    if source == "predicted":
        return Need.PREDICTED_DEPTH
    if source == "sensor":
        return Need.SENSOR_DEPTH
    raise DeuxError(f'{option} is "{source}": it must be "predicted" or "sensor".')


def depth_of(observation: Observation, source: DepthSource) -> np.ndarray:
    """The H x W depth image of that source."""
    depth = observation.predicted_depth if source == "predicted" else observation.sensor_depth
    assert depth is not None
    return depth


def errors_of(source: DepthSource) -> DepthErrors:
    """How wrong depth of that source may be."""
    return PREDICTION if source == "predicted" else EXACT
