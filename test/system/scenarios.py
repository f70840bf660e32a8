"""What must be true of a running graph, however its nodes were started.

`test_scenarios.py` starts them as processes, `test/launch` by launch files.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import QuaternionStamped
from graph import Graph, nanoseconds, until
from sensor_msgs.msg import Imu, MagneticField
from std_msgs.msg import Float64

from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.rotor import Rotor, conjugate, difference, dot, product


def rotor_of(quaternion: Any) -> Rotor:
    return (quaternion.w, quaternion.x, quaternion.y, quaternion.z)


ENU = WorldFrame("enu")


def errors_deg(
    orientations: list[Imu], truth: list[QuaternionStamped], world: WorldFrame = ENU
) -> np.ndarray:
    """Errors of orientations in a world frame where the truth (ENU) has the same stamp."""
    from_enu = product(world.rotor, conjugate(ENU.rotor))
    true = {
        nanoseconds(message): product(from_enu, rotor_of(message.quaternion)) for message in truth
    }
    return np.array(
        [
            math.degrees(difference(rotor_of(message.orientation), true[nanoseconds(message)]))
            for message in orientations
            if nanoseconds(message) in true
        ]
    )


def flips(orientations: list[Imu]) -> int:
    """How often the published rotor changed its sign."""
    rotors = [rotor_of(message.orientation) for message in orientations]
    return sum(dot(p, q) < 0.0 for p, q in itertools.pairwise(rotors))


def status(diagnostics: list[DiagnosticArray], node: str) -> tuple[bytes, str, dict[str, str]]:
    """Level, message and values of a node's last status."""
    for array in reversed(diagnostics):
        for entry in array.status:
            if entry.name.startswith(f"{node}:"):
                return entry.level, entry.message, {v.key: v.value for v in entry.values}
    return b"", "", {}


def driver_and_fusion_agree_with_the_truth(graph: Graph) -> None:
    """The whole chain: simulated registers → driver → DDS → fusion, within 2° after a second."""
    orientations = graph.hear(Imu, "imu/data")
    raw = graph.hear(Imu, "imu/data_raw")
    field = graph.hear(MagneticField, "imu/mag")
    truth = graph.hear(QuaternionStamped, "ground_truth")
    diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
    until(lambda: len(orientations) > 700 and len(truth) > 700, "seven hundred orientations")
    until(lambda: status(diagnostics, "fusion")[1] == "Orientation from nine axes.", "diagnostics")
    until(lambda: status(diagnostics, "imu_driver")[0] == b"\x00", "the driver to be well")
    assert errors_deg(orientations, truth)[300:].max() < 2.0
    assert flips(orientations) == 0
    assert all(message.orientation_covariance[0] == -1.0 for message in raw)  # REP-145
    assert {nanoseconds(m) for m in field[1:-1]} <= {nanoseconds(m) for m in raw}  # one stamp


TURNS = Path(__file__).parents[1] / "bags" / "turns"
NWU = WorldFrame("nwu")  # as in the paper


def a_bag_is_followed_to_its_end(graph: Graph, play: Callable[[], object]) -> None:
    """The paper's experiment: a turn about y, then one about z, from `TURNS` into fusion (NWU).

    Every sample is answered, within 2° after the first second, and two turns are counted.
    """
    orientations = graph.hear(Imu, "imu/data")
    angles = graph.hear(Float64, "imu/angle")
    diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
    until(lambda: status(diagnostics, "fusion")[1], "fusion, which then hears and is heard")
    truth = graph.hear(QuaternionStamped, "ground_truth")  # for which the player waits
    play()
    until(lambda: len(orientations) == 950, "an orientation for each sample")
    errors = errors_deg(orientations, truth, NWU)
    assert len(errors) > 500  # the truth, heard by the test alone, may begin late
    assert errors[-850:].max() < 2.0
    assert flips(orientations) == 0
    assert abs(angles[-1].data - 4 * math.pi) < math.radians(2.0)


def alpha_is_live(graph: Graph) -> None:
    """A new α is taken at once; one out of range is refused with a reason."""
    diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
    assert graph.set_parameter("fusion", "alpha", 0.99).successful
    until(lambda: status(diagnostics, "fusion")[2].get("alpha") == "0.99", "α in /diagnostics")
    for value, reason in ((1.5, "out of range"), (math.nan, "out of range"), (1, "write 1.0")):
        result = graph.set_parameter("fusion", "alpha", value)
        assert not result.successful
        assert reason in result.reason
    assert status(diagnostics, "fusion")[2]["alpha"] == "0.99"
