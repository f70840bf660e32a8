"""From the filters' earth frame, north-west-up, to the world frame that a user asked for."""

from __future__ import annotations

import math

import numpy as np

from ..errors import UsageError
from ..rotor import (
    IDENTITY,
    Rotor,
    Vector,
    from_axis_angle,
    negative,
    product,
    rotate,
)
from .samples import Array

_HALF = math.sqrt(0.5)

# The rotor NWU → world frame.
WORLD_FRAMES: dict[str, Rotor] = {
    "enu": (_HALF, 0.0, 0.0, _HALF),
    "nwu": (1.0, 0.0, 0.0, 0.0),
    "ned": (0.0, 1.0, 0.0, 0.0),
}


class WorldFrame:
    """Turns the filter's rotors into a world frame, with true instead of magnetic north.

    ``declination`` (rad) is the angle from true to magnetic north, positive to the east. The
    first rotor has w ≥ 0; each further one has the sign that continues the last, whatever the
    filter does in between.
    """

    def __init__(self, name: str = "enu", declination: float = 0.0) -> None:
        if name not in WORLD_FRAMES:
            raise UsageError(f"world_frame must be one of {', '.join(WORLD_FRAMES)}, got {name!r}.")
        if not abs(declination) <= math.pi:
            raise UsageError(
                f"magnetic_declination must be between -π and π rad, got {declination}."
            )
        self.rotor = product(WORLD_FRAMES[name], from_axis_angle((0.0, 0.0, 1.0), -declination))
        self._last: Rotor = IDENTITY

    @property
    def north_at_zero_yaw(self) -> Vector:
        """Where magnetic north is, in the sensor frame, when roll, pitch and yaw are zero."""
        return rotate(self.rotor, (1.0, 0.0, 0.0))

    def update(self, rotor: Rotor) -> Rotor:
        """A filter's rotor (sensor → NWU) as sensor → world, continuing the last one's sign."""
        c, i, j, s = self.rotor
        if i == 0.0 and j == 0.0:  # about the vertical, as in enu and nwu: a shorter product
            w, x, y, z = rotor
            rotor = (c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w)
        else:
            rotor = product(self.rotor, rotor)
        w, x, y, z = rotor
        p, q, r, s = self._last
        if w * p + x * q + y * r + z * s < 0.0:
            rotor = negative(rotor)
        self._last = rotor
        return rotor

    def all(self, rotors: Array) -> Array:
        """The same for a whole recording, (n, 4), with signs as the filter gave them."""
        return np.stack(product(self.rotor, tuple(rotors.T)), axis=1)
