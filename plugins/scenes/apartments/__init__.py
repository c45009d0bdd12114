"""Generated flats: several furnished rooms from a seed, without downloads."""

from deux_plugins.scenes.apartments.generator import APARTMENT_VERSION, apartment
from deux_plugins.scenes.apartments.source import ApartmentReference, Apartments
from deux_plugins.scenes.parts.labels import LABEL_NAMES

__all__ = ["APARTMENT_VERSION", "LABEL_NAMES", "ApartmentReference", "Apartments", "apartment"]
