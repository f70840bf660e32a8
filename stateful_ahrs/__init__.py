"""Orientation from a cheap nine-axis sensor: one rotor that never flips sign."""

__version__ = "0.1.0"
