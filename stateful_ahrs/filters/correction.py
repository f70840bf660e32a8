"""The blend of eq. 16 as a turn of the predicted rotor.

The snapshot ``s`` is ``δ p``, where ``p`` is the predicted rotor and ``δ`` the turn, in the earth
frame, from what is predicted to what is seen. So

    α p + (1 − α) s  =  (α + (1 − α) δ) p,

and where ``δ`` has w ≥ 0 the snapshot is the one of its two that continues ``p`` (eq. 3–4). That
takes half the time of a snapshot by itself, tells the slow room what was corrected, and lets
heading be corrected less than tilt: ``δ`` is a turn about the vertical after one about a level axis.
"""

from __future__ import annotations

import math

from ..rotor import IDENTITY, Rotor, Vector, carried
from .senses import LEVEL, Felt, Senses, Sources, notice

UPSIDE_DOWN = 1e-3  # of up: less of it above the opposite of the predicted one tells no axis


def corrected(
    senses: Senses,
    sources: Sources,
    felt: Felt,
    accel: Vector,
    mag: Vector,
    predicted: Rotor,
    dt: float,
    weight: float,
    share: float,
) -> tuple[Senses, Rotor]:
    """What is remembered of a sample, and ``α + (1 − α) δ`` for α = ``weight``; 1 without up.

    For a filter that has started. ``predicted`` is a unit rotor; ``share`` is the part of the
    heading's turn in ``δ``: 1 is north as measured, 0 as predicted.
    """
    turn, rate, gyro_rejected = felt
    _, last_mag, _, started, heading_known, turned, sign_corrections, _, _, _, _, _ = senses
    up, has_up, field, fresh, mag_age, accel_rejected, mag_rejected, up_kept, up_time = notice(
        senses, sources, turn, accel, mag, dt
    )
    change = IDENTITY
    if has_up:
        ux, uy, uz = up
        fx, fy, fz = field
        square = ux * ux + uy * uy + uz * uz
        along = ux * fx + uy * fy + uz * fz
        whole = square * (fx * fx + fy * fy + fz * fz)
        across = whole - along * along
        has_north = across > LEVEL * LEVEL * whole

        w, x, y, z = predicted
        a, b, xy, wz, xz, wy = w * w - z * z, x * x - y * y, x * y, w * z, x * z, w * y
        north_x, north_y, north_z = a + b, 2.0 * (xy - wz), 2.0 * (xz + wy)
        west_x, west_y, west_z = 2.0 * (xy + wz), a - b, 2.0 * (y * z - w * x)
        to_north = north_x * ux + north_y * uy + north_z * uz
        to_west = west_x * ux + west_y * uy + west_z * uz
        up_x, up_y, up_z = 2.0 * (xz - wy), 2.0 * (y * z + w * x), w * w + z * z - x * x - y * y
        length = math.sqrt(square)
        above = length + up_x * ux + up_y * uy + up_z * uz
        if not above > UPSIDE_DOWN * length:
            above, to_north, to_west = 0.0, 0.0, length
        # The turn from (to_north, to_west, above - length) to up is (above, to_west, -to_north, 0).
        cosine, sine = 2.0, 0.0  # of half the turn from the measured north to the predicted one
        if not has_north:
            if fresh:
                fresh = False
                mag_rejected += 1
                field = carried(turn, last_mag)
        elif heading_known and sources.use_mag and (fresh or mag_age <= sources.mag_timeout):
            s = share * math.sqrt(square / across)  # over the length of the level field
            cosine = 2.0 - share + s * (north_x * fx + north_y * fy + north_z * fz)
            sine = -s * (west_x * fx + west_y * fy + west_z * fz)
            if cosine * cosine + sine * sine < 1e-9:
                sine = 2.0
        level = cosine * cosine + sine * sine
        s = (1.0 - weight) / math.sqrt(
            level * (above * above + to_north * to_north + to_west * to_west)
        )
        cosine, sine = s * cosine, s * sine
        change = (
            weight + cosine * above,
            cosine * to_west + sine * to_north,
            sine * to_west - cosine * to_north,
            sine * above,
        )
    if fresh:
        mag_age = 0.0

    was_turned = turned
    turned = -min(predicted) > max(predicted)  # the sign that a snapshot has of its own
    if turned != was_turned:
        sign_corrections += 1
    now = Senses(
        rate,
        field,
        mag_age,
        started,
        heading_known,
        turned,
        sign_corrections,
        gyro_rejected,
        accel_rejected,
        mag_rejected,
        up_kept,
        up_time,
    )
    return now, change
