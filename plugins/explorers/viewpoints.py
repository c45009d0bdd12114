"""The ceiling: training frames from free viewpoints with ideal source frames."""

from deux.contracts import FreeViewpoints


class ViewpointCeiling(FreeViewpoints):
    """No robot: free poses spread evenly over the training scenes, each with two ideal source frames.

    It is privileged, since it goes anywhere and chooses source frames by true depth: cameras 0.15 to 0.8 m away, turned
    by less than 40 degrees, that see at least 0.3 of the same surfaces. It gives as many target frames as a robot's
    episodes do. What it reaches is a ceiling for explorers; tables set it apart and never rank it.
    """
