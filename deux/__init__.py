"""Active exploration for learning unsupervised depth perception."""

__version__ = "0.1.0"
