"""Depth Anything as a depth model of deux."""
