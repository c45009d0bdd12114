"""Generated flats: several furnished rooms from a seed, nothing to download."""

from deux_plugins.scenes.apartments.generator import APARTMENT_VERSION, apartment
from deux_plugins.scenes.apartments.labels import LABEL_NAMES
from deux_plugins.scenes.apartments.source import ApartmentReference, Apartments

__all__ = ["APARTMENT_VERSION", "LABEL_NAMES", "ApartmentReference", "Apartments", "apartment"]
