"""Bags and data sets in, samples out; knows no ROS graph."""

from .load import load
from .recording import Progress, Recording, samples
from .write import write

__all__ = ["Progress", "Recording", "load", "samples", "write"]
