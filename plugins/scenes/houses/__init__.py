"""Generated houses: large furnished buildings with one floor from a seed, without downloads."""

from deux_plugins.scenes.houses.generator import HOUSE_VERSION, house
from deux_plugins.scenes.houses.source import HouseReference, Houses

__all__ = ["HOUSE_VERSION", "HouseReference", "Houses", "house"]
