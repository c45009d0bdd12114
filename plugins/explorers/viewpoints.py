"""The ceiling for explorers: training frames from free viewpoints with ideal source frames."""

from deux.contracts import FreeViewpoints


class ViewpointCeiling(FreeViewpoints):
    """Free poses spread evenly over the training scenes, without a robot, each with two ideal source frames.

    It is privileged: poses can be anywhere, and source frames are chosen by true depth, from cameras 0.15 to 0.8 m away
    and turned by less than 40 degrees that see at least 0.3 of the same surfaces. It gives as many target frames as a
    robot's episodes. Its result is a ceiling for explorers, which tables show separately and never rank.
    """
