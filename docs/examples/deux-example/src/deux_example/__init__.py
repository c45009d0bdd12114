"""Plugins for deux, one of each kind."""
