"""Measurements of the plugin against itself and its peers: speed, and error against run time."""
