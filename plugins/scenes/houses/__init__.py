"""Generated houses: large furnished buildings on one floor from a seed, nothing to download."""

from deux_plugins.scenes.houses.generator import HOUSE_VERSION, house
from deux_plugins.scenes.houses.source import HouseReference, Houses

__all__ = ["HOUSE_VERSION", "HouseReference", "Houses", "house"]
