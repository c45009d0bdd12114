"""Plugins for deux: an explorer, a depth model and a loss term."""
