"""Readers of recorded frames, one file each, in the layouts that the public datasets and cameras write."""
