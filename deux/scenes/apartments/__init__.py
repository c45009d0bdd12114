"""Generated flats: several furnished rooms from a seed, nothing to download."""

from deux.scenes.apartments.generator import APARTMENT_VERSION, apartment
from deux.scenes.apartments.labels import LABEL_NAMES

__all__ = ["APARTMENT_VERSION", "LABEL_NAMES", "apartment"]
