"""What can go wrong, each as one sentence: the input, what was found, what was expected."""

from __future__ import annotations


class AhrsError(Exception):
    """Base of every error that the package raises on purpose; its text is meant for the user."""

    exit_code = 1


class UsageError(AhrsError):
    """The command or a setting was given something it does not know."""

    exit_code = 2


class RecordingError(AhrsError):
    """A recording is missing, damaged, or not what its name says."""


class TopicError(RecordingError):
    """A bag lacks a topic that was asked for."""


class DeviceError(AhrsError):
    """A sensor is absent, silent, or not the one expected."""
