"""Readers of recorded frames, one module for each layout of public datasets and cameras."""
