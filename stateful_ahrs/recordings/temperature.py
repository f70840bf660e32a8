"""The temperature that a bag tells of."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .opening import damage_told, is_ros1, reader
from .wire import TEMPERATURE, decode


def temperature(path: Path | str) -> float | None:
    """Mean of the first sensor_msgs/Temperature topic of a bag, °C; None if it tells nothing."""
    path = Path(path)
    with damage_told(path), reader(path) as opened:
        topics = [c.topic for c in opened.connections if c.msgtype == TEMPERATURE and c.msgcount]
        wanted = [c for c in opened.connections if c.topic in topics[:1]]
        if not wanted:
            return None
        told = [message for _, _, message in opened.messages(connections=wanted)]
        values = decode(TEMPERATURE, told, ros1=is_ros1(path))[1][:, 0]
    return float(values[np.isfinite(values)].mean()) if np.isfinite(values).any() else None
