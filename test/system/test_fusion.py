"""The running fusion node: the paper's experiment, loops, garbage, world frames, services."""

from __future__ import annotations

import math
import re
import signal
import struct
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import QuaternionStamped, Vector3Stamped
from graph import Graph, nanoseconds, until
from rosgraph_msgs.msg import Clock
from scenarios import errors_deg, flips, rotor_of, status
from sensor_msgs.msg import Imu, MagneticField
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from stateful_ahrs import filters
from stateful_ahrs.filters.frames import WorldFrame
from stateful_ahrs.mpu9250 import calibration_file
from stateful_ahrs.recordings import load, samples
from stateful_ahrs.rotor import difference, from_axis_angle, product

BAGS = Path(__file__).parents[1] / "bags"
SECOND = 1_000_000_000
PERIOD = SECOND // 100
START = 1_000 * SECOND
LEVEL = (0.0, 0.0, 9.81)
NORTH = (20e-6, 0.0, -40e-6)


class Sensor:
    """Publishes samples by hand."""

    def __init__(self, graph: Graph, field=NORTH) -> None:
        self.imu = graph.speak(Imu, "imu/data_raw")
        self.fields = graph.speak(MagneticField, "imu/mag") if field else None
        self._field = field
        self.heard = graph.hear(Imu, "imu/data")
        until(lambda: graph.node.count_publishers("imu/data") > 0, "imu/data")
        self.sent = 0
        until(self._heard_back, "the first orientation")
        last = START - 50 * SECOND
        self.send(last)
        until(lambda: nanoseconds(self.heard[-1]) == last, "the last answer of the warm-up")
        self.heard.clear()

    def _heard_back(self) -> bool:
        self.send(START - 100 * SECOND + self.sent * PERIOD)
        return bool(self.heard)

    def send(self, stamp, gyro=(0.0, 0.0, 0.0), accel=LEVEL, mag=(), mag_first=True):
        mag = self._field if mag == () else mag
        imu = Imu()
        imu.header.frame_id = "imu_link"
        imu.header.stamp.sec, imu.header.stamp.nanosec = divmod(stamp, SECOND)
        for vector, values in ((imu.angular_velocity, gyro), (imu.linear_acceleration, accel)):
            vector.x, vector.y, vector.z = values
        field = MagneticField(header=imu.header)
        if mag is not None and mag_first:
            field.magnetic_field.x, field.magnetic_field.y, field.magnetic_field.z = mag
            self.fields.publish(field)
        self.imu.publish(imu)
        if mag is not None and not mag_first:
            field.magnetic_field.x, field.magnetic_field.y, field.magnetic_field.z = mag
            self.fields.publish(field)
        self.sent += 1

    def send_all(self, stamps, **sample):
        """Send and wait for the answer to each (all are answered)."""
        for stamp in stamps:
            before = len(self.heard)
            self.send(stamp, **sample)
            until(lambda before=before: len(self.heard) > before, f"an orientation at {stamp}")
        return self.heard[-1]


def ticks(count, start=START):
    return [start + i * PERIOD for i in range(count)]


@pytest.fixture
def sensor(graph):
    graph.start("fusion")
    return Sensor(graph)


both_lanes = pytest.mark.parametrize("fast", [True, False], ids=["bytes", "messages"])


def counts(graph, **expected):
    """Wait until /diagnostics of fusion shows the values."""
    heard = graph.hear(DiagnosticArray, "/diagnostics")

    def shown():
        values = status(heard, "fusion")[2]
        return values and all(values.get(name) == str(value) for name, value in expected.items())

    until(shown, f"diagnostics with {expected}")
    return status(heard, "fusion")


# The paper's experiment


def test_the_stateless_filter_fails_where_the_scenario_shows_the_stateful_one_following(graph):
    orientations = graph.hear(Imu, "imu/data")
    truth = graph.hear(QuaternionStamped, "ground_truth")
    graph.start("fusion", stateful=False, world_frame="nwu")  # as in the paper
    graph.until_published("imu/data")
    graph.start("bag_player", str(BAGS / "turns"), "--wait", "20", "--rate", "4")
    until(lambda: len(orientations) == 950, "all 950 orientations")
    assert errors_deg(orientations, truth, WorldFrame("nwu")).max() > 90.0


@pytest.mark.parametrize(("name", "fast"), [("stateful", True), ("paper", False)])
def test_live_and_offline_are_the_same(graph, name, fast):
    recording = load(BAGS / "turns")
    offline = WorldFrame("enu").all(filters.make(name, settings("enu")).run(samples(recording)))
    orientations = graph.hear(Imu, "imu/data")
    graph.start("fusion", filter=name, fast_lane=fast)
    graph.until_published("imu/data")
    assert (
        graph.start("bag_player", str(BAGS / "turns"), "--wait", "20", "--rate", "8").wait(30.0)
        == 0
    )
    until(lambda: len(orientations) == len(recording), "every orientation")
    worst = max(
        difference(rotor_of(message.orientation), tuple(q))
        for message, q in zip(orientations, offline, strict=True)
    )
    assert worst < 1e-6  # rad
    assert [nanoseconds(message) for message in orientations] == recording.stamps.tolist()


def settings(frame):
    return filters.Settings(north_at_start=WorldFrame(frame).north_at_zero_yaw)


def test_what_a_filter_learned_is_in_diagnostics(graph):
    heard = graph.hear(DiagnosticArray, "/diagnostics")
    graph.start("fusion")
    until(lambda: status(heard, "fusion")[2].get("mag_trust") == "1", "the filter's own values")
    values = status(heard, "fusion")[2]
    assert values["learned_bias_rad_s"] == "0 0 0"
    assert values["heading_stddev_rad"] == "inf"


# Stamps and clocks


def test_a_looped_bag_restarts_the_filter_and_never_flips_the_rotor(graph):
    orientations = graph.hear(Imu, "imu/data")
    truth = graph.hear(QuaternionStamped, "ground_truth")
    fusion = graph.start("fusion", use_sim_time=True)
    graph.until_published("imu/data")
    player = graph.start(
        "bag_player", str(BAGS / "turns"), "--wait", "20", "--loop", "--clock", "--rate", "8"
    )
    until(lambda: len(orientations) > 2.5 * 950, "two and a half rounds")
    values = counts(graph, stamps_gaps=0, stamps_out_of_order=0)[2]
    assert player.end() == 0
    assert int(values["stamps_jumps_back"]) >= 2
    assert int(values["stamps_clock_jumps"]) >= 2
    assert flips(orientations) == 0
    stamps = np.array([nanoseconds(message) for message in orientations])
    since_start = stamps - stamps.min()
    settled = [m for m, t in zip(orientations, since_start, strict=True) if t > SECOND]
    assert errors_deg(settled, truth).max() < 2.0
    assert fusion.said.count("jump back") == 1  # said once, counted often


@pytest.mark.parametrize(
    ("stamp", "count"),
    [
        (START + 99 * PERIOD, "stamps_duplicate"),
        (START + 97 * PERIOD, "stamps_out_of_order"),
        (0, "stamps_zero"),
    ],
)
def test_a_bad_stamp_is_skipped_counted_and_said(graph, sensor, stamp, count):
    sensor.send_all(ticks(100))
    sensor.send(stamp, gyro=(9.0, 9.0, 9.0), mag=None)
    last = sensor.send_all([START + 100 * PERIOD])
    assert len(sensor.heard) == 101  # the bad one has no answer
    assert difference(rotor_of(last.orientation), rotor_of(sensor.heard[98].orientation)) < 1e-6
    counts(graph, **{count: 1})


@pytest.mark.parametrize("jump", [-500 * SECOND, 500 * SECOND])
def test_a_jump_of_the_stamps_starts_anew(graph, sensor, jump):
    sensor.send_all(ticks(50))
    # by the gap's end the sensor lies on its side: at once, not after the time constant
    on_side = sensor.send_all([START + jump], accel=(0.0, 9.81, 0.0), mag=(20e-6, -40e-6, 0.0))
    level = rotor_of(sensor.heard[49].orientation)
    assert difference(rotor_of(on_side.orientation), level) == pytest.approx(math.pi / 2, abs=1e-6)
    assert flips(sensor.heard) == 0


def test_a_sender_that_does_not_stamp_gets_orientations_by_time_of_arrival(graph):
    graph.start("fusion")
    imu = graph.speak(Imu, "imu/data_raw")
    heard = graph.hear(Imu, "imu/data")
    message = Imu()
    message.linear_acceleration.z = 9.81

    def answered():
        imu.publish(message)
        return len(heard) > 5

    until(answered, "orientations")
    stamps = [nanoseconds(message) for message in heard]
    assert all(stamp > 0 for stamp in stamps)
    assert stamps == sorted(stamps)


# Magnetometers


def test_the_order_in_which_a_pair_arrives_does_not_matter(graph, sensor):
    rate = (0.0, 0.0, 1.0)
    for i, stamp in enumerate(ticks(200)):
        angle = -0.01 * i
        field = (20e-6 * math.cos(angle), 20e-6 * math.sin(angle), -40e-6)
        sensor.send_all([stamp], gyro=rate, mag=field, mag_first=i % 2 == 0)
    values = counts(graph)[2]
    assert values["mag_superseded"] == "0"
    yaw = from_axis_angle((0.0, 0.0, 1.0), 199 * 0.01)
    truth = product(WorldFrame("enu").rotor, yaw)
    assert difference(rotor_of(sensor.heard[-1].orientation), truth) < 1e-4


def test_without_a_magnetometer_every_sample_is_answered_and_diagnostics_say_so(graph):
    graph.start("fusion")
    sensor = Sensor(graph, field=None)
    answer = sensor.send_all(ticks(100))
    assert len(sensor.heard) == 100
    # yaw 0 in ENU as long as nothing tells north, and no idea of the true one
    assert rotor_of(answer.orientation) == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-9)
    assert answer.orientation_covariance[8] == pytest.approx(math.pi**2)
    assert answer.orientation_covariance[0] < 0.01
    diagnostics = graph.hear(DiagnosticArray, "/diagnostics")

    def warned():
        sensor.send(START + sensor.sent * PERIOD)
        return "No sample on /imu/mag yet (0 publishers)" in status(diagnostics, "fusion")[1]

    until(warned, "the warning")
    assert status(diagnostics, "fusion")[2]["heading"] == "gyroscope"


def test_a_magnetometer_without_stamps_serves_the_next_sample(graph, sensor):
    sensor.send_all(ticks(3))
    unstamped = MagneticField()
    unstamped.magnetic_field.y = -20e-6  # facing east
    for i in range(3, 300):
        sensor.fields.publish(unstamped)
        sensor.send_all([START + i * PERIOD], mag=None)
    east = rotor_of(sensor.heard[-1].orientation)
    assert difference(east, rotor_of(sensor.heard[0].orientation)) > 0.5
    assert int(counts(graph)[2]["mag_unstamped"]) == 297


def test_two_sensors_on_one_topic_are_an_error(graph, sensor):
    graph.speak(Imu, "imu/data_raw")
    diagnostics = graph.hear(DiagnosticArray, "/diagnostics")

    def told():
        sensor.send(START + sensor.sent * PERIOD)
        return status(diagnostics, "fusion")[1] == (
            "2 publishers on /imu/data_raw: sensors are mixed, unless one has just crashed."
        )

    until(told, "the error")
    assert status(diagnostics, "fusion")[0] == b"\x01"


@pytest.mark.parametrize(
    ("sample", "name"),
    [({"gyro": (math.nan,) * 3}, "gyroscope"), ({"accel": (0.0, 0.0, 0.0)}, "accelerometer")],
)
def test_a_sensor_that_gives_nothing_usable_is_a_warning(graph, sensor, sample, name):
    diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
    sensor.send_all([START + sensor.sent * PERIOD])  # it has started

    def told():
        sensor.send(START + sensor.sent * PERIOD, **sample)
        sentence = status(diagnostics, "fusion")[1]
        return re.fullmatch(rf"Of the last \d+ {name} samples, \d+ were rejected\.", sentence)

    until(told, "the warning")
    assert status(diagnostics, "fusion")[0] == b"\x01"


# Garbage


GARBAGE = [math.nan, math.inf, -math.inf, 0.0, 1e308]


def test_garbage_in_no_garbage_out(graph, sensor):
    good = rotor_of(sensor.send_all(ticks(100)).orientation)
    i = 100
    for bad in GARBAGE:
        vector = (bad, bad, bad)
        for sample in (
            {"gyro": vector},
            {"accel": vector},
            {"mag": vector},
            {"mag": (0.0, 0.0, bad)},  # along gravity
            {"gyro": vector, "accel": vector, "mag": vector},
        ):
            bad_answer = sensor.send_all([START + i * PERIOD], **sample)
            good_answer = sensor.send_all([START + (i + 1) * PERIOD])
            i += 2
            assert difference(rotor_of(bad_answer.orientation), good) < math.radians(1.0)
            assert difference(rotor_of(good_answer.orientation), good) < math.radians(1.0)
    for message in sensor.heard:
        numbers = [
            *rotor_of(message.orientation),
            message.angular_velocity.x,
            message.linear_acceleration.y,
            *message.orientation_covariance,
        ]
        assert np.isfinite(numbers).all()
        assert math.hypot(*rotor_of(message.orientation)) == pytest.approx(1.0, abs=1e-9)
    values = counts(graph)[2]
    assert int(values["gyro_rejected"]) == 8  # not zero, which is a rate
    assert int(values["accel_rejected"]) == 10
    assert int(values["mag_rejected"]) + int(values["mag_empty"]) == 15


@both_lanes
def test_a_field_that_is_not_a_number_is_published_as_not_reported(graph, fast):
    graph.start("fusion", fast_lane=fast)
    answer = Sensor(graph).send_all([START], gyro=(math.nan, 0.0, 0.0), accel=(0.0, math.inf, 9.8))
    assert answer.angular_velocity_covariance[0] == -1.0
    assert answer.linear_acceleration_covariance[0] == -1.0


def big_endian(stamp, accel):
    """An Imu in the frame `base`."""
    doubles = [0.0] * 37
    doubles[25:28] = accel
    head = struct.pack(">4siII", bytes(4), *divmod(stamp, SECOND), 5)
    return head + b"base\0".ljust(12, b"\0") + struct.pack(">37d", *doubles)


def test_a_message_in_another_encoding_is_answered_and_one_that_is_none_is_counted(graph, sensor):
    level = rotor_of(sensor.send_all(ticks(1)).orientation)
    for message in (b"\x00\x01", big_endian(START + PERIOD, LEVEL)):
        sensor.imu.publish(message)
    until(lambda: len(sensor.heard) == 2, "the answer")
    assert sensor.heard[1].header.frame_id == "base"
    assert nanoseconds(sensor.heard[1]) == START + PERIOD
    assert difference(rotor_of(sensor.heard[1].orientation), level) < 0.01
    counts(graph, left_the_fast_lane=1, malformed=1)


def test_before_the_first_usable_sample_the_orientation_is_not_reported(graph):
    graph.start("fusion")
    imu = graph.speak(Imu, "imu/data_raw")
    heard = graph.hear(Imu, "imu/data")
    until(lambda: imu.publish(Imu()) or heard, "an answer")  # zero acceleration
    assert heard[0].orientation_covariance[0] == -1.0


# Parameters, services and derived topics


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        ("enu", from_axis_angle((0.0, 0.0, 1.0), math.pi / 2)),
        ("nwu", (1.0, 0.0, 0.0, 0.0)),
        ("ned", (0.0, 1.0, 0.0, 0.0)),
    ],
)
def test_level_and_facing_north_in_each_world_frame(graph, frame, expected):
    graph.start("fusion", world_frame=frame, orientation_stddev=0.1)
    answer = Sensor(graph).send_all(ticks(3))
    assert difference(rotor_of(answer.orientation), expected) < 1e-6
    assert answer.orientation_covariance[::4] == pytest.approx([0.01, 0.01, 0.01])
    assert answer.header.frame_id == "imu_link"


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"alpha": 1}, "alpha must be a double, got an integer (1): write 1.0 instead of 1."),
        ({"alpha": 1.2}, "alpha must be between 0 and 1, got 1.2."),
        ({"alpha": ".nan"}, "alpha must be between 0 and 1, got nan."),
        ({"filter": "kalman"}, "there is no filter 'kalman'; there are stateful, paper"),
        ({"world_frame": "nue"}, "world_frame must be one of enu, nwu, ned, got 'nue'."),
        (
            {"orientation_stddev": ".nan"},
            "orientation_stddev must be finite, in rad, or negative",
        ),
        ({"publish_tf": True}, "publish_tf needs tf2_ros"),
        (
            {"qos_overrides./imu/data_raw.subscription.reliability": "nonsense"},
            "the QoS for imu/data_raw cannot be used",
        ),
        (
            {"qos_overrides./imu/data.publisher.depth": -3},
            "the QoS for imu/data cannot be used: depth must be between 0 and 2147483647, got -3.",
        ),
        (
            {"qos_overrides./imu/mag.subscription.depth": 2**31},
            "the QoS for imu/mag cannot be used: depth must be between 0 and 2147483647, got 2147",
        ),
    ],
)
def test_a_wrong_parameter_ends_the_node_with_one_sentence(graph, parameters, sentence):
    if "publish_tf" in parameters and has_tf2():
        pytest.skip("tf2_ros is installed here")
    fusion = graph.start("fusion", **parameters)
    assert fusion.wait() == 2
    assert sentence in fusion.said
    assert "Traceback" not in fusion.said
    assert len(fusion.said.splitlines()) == 1


def has_tf2():
    try:
        import tf2_ros  # noqa: F401
    except ImportError:
        return False
    return True


@pytest.mark.parametrize(
    ("name", "value"), [("world_frame", "ned"), ("filter", "paper"), ("publish_tf", True)]
)
def test_what_is_not_live_is_refused(graph, name, value):
    graph.start("fusion")
    result = graph.set_parameter("fusion", name, value)
    assert not result.successful
    assert "read-only" in result.reason


def test_live_parameters_take_effect_with_the_next_sample(graph, sensor):
    sensor.send_all(ticks(200))
    assert graph.set_parameter("fusion", "alpha", 0.0).successful
    assert graph.set_parameter("fusion", "low_pass", False).successful
    tilted = (0.0, 9.81 * math.sin(0.2), 9.81 * math.cos(0.2))
    answer = sensor.send_all([START + 200 * PERIOD], accel=tilted)
    level = rotor_of(sensor.heard[199].orientation)
    assert difference(rotor_of(answer.orientation), level) > 0.19
    assert graph.set_parameter("fusion", "orientation_stddev", 0.2).successful
    answer = sensor.send_all([START + 201 * PERIOD])
    assert answer.orientation_covariance[0] == pytest.approx(0.04)


def test_a_chosen_deviation_is_for_a_heading_that_is_known(graph):
    graph.start("fusion", orientation_stddev=0.1)
    sensor = Sensor(graph)
    for mag, yaw in ((None, math.pi), ((20e-6, 0.0, -40e-6), 0.1)):
        covariance = sensor.send_all([START + len(sensor.heard) * PERIOD], mag=mag)
        assert covariance.orientation_covariance[::4] == pytest.approx([0.01, 0.01, yaw**2])


@both_lanes
def test_axis_angle_and_euler_angles_follow_the_orientation(graph, fast):
    graph.start("fusion", world_frame="nwu", fast_lane=fast)
    sensor = Sensor(graph)
    derived = [
        graph.hear(Vector3Stamped, "imu/axis"),
        graph.hear(Float64, "imu/angle"),
        graph.hear(Vector3Stamped, "imu/rpy"),
    ]
    i = 0

    def all_heard():
        nonlocal i
        sensor.send_all([START + i * PERIOD])
        i += 1
        return all(derived)

    until(all_heard, "axis, angle and Euler angles")
    for k in range(1, 401):  # two turns about z at π rad/s
        angle = -2 * math.pi * k / 200
        field = (20e-6 * math.cos(angle), 20e-6 * math.sin(angle), -40e-6)
        sensor.send_all([START + i * PERIOD], gyro=(0.0, 0.0, math.pi), mag=field)
        i += 1
    axis, angle, rpy = derived
    until(lambda: angle[-1].data == pytest.approx(4 * math.pi, abs=0.01), "an angle of 4π")
    values = counts(graph)[2]
    assert float(values["angle_rad"]) == pytest.approx(4 * math.pi, abs=0.01)
    assert [float(part) for part in values["axis"].split()] == pytest.approx([0, 0, 1], abs=0.01)
    assert axis[-1].vector.z == pytest.approx(1.0, abs=0.01)
    assert rpy[-1].vector.z == pytest.approx(0.0, abs=0.01)
    assert axis[-1].header.frame_id == "imu_link"


def test_reset_starts_anew(graph, sensor):
    sensor.send_all(ticks(100))
    assert graph.call(Trigger, "fusion/reset").success
    on_side = sensor.send_all(
        [START + 100 * PERIOD], accel=(0.0, 9.81, 0.0), mag=(20e-6, -40e-6, 0.0)
    )
    level = rotor_of(sensor.heard[99].orientation)
    assert difference(rotor_of(on_side.orientation), level) == pytest.approx(math.pi / 2, abs=1e-6)
    assert flips(sensor.heard) == 0


def test_the_bias_is_taken_at_rest_and_refused_in_motion(graph, sensor):
    sensor.send_all(ticks(50), gyro=(0.01, 0.0, 0.0))
    refused = graph.call(Trigger, "fusion/calibrate_gyro")
    assert not refused.success
    assert "keep the sensor still for 2 s" in refused.message
    sensor.send_all(ticks(201, START + 50 * PERIOD), gyro=(0.01, 0.0, -0.02))
    assert graph.call(Trigger, "fusion/calibrate_gyro").success
    answer = sensor.send_all([START + 251 * PERIOD], gyro=(0.11, 0.0, -0.02))
    assert answer.angular_velocity.x == pytest.approx(0.1, abs=1e-3)
    assert answer.angular_velocity.z == pytest.approx(0.0, abs=1e-3)
    sensor.send_all(ticks(10, START + 252 * PERIOD), gyro=(5.0, 0.0, 0.0))
    assert not graph.call(Trigger, "fusion/calibrate_gyro").success


def test_what_was_learned_is_saved_and_starts_the_next_run(graph, tmp_path):
    path = str(tmp_path / "imu.yaml")
    fusion = graph.start("fusion", calibration_file=path)
    Sensor(graph).send_all(ticks(600), gyro=(0.01, 0.0, -0.02))
    done = graph.call(Trigger, "fusion/save_calibration")
    assert done.success, done.message
    assert calibration_file.load(path).learned.bias == pytest.approx((0.01, 0.0, -0.02), abs=1e-3)
    assert fusion.end() == 0
    graph.start("fusion", calibration_file=path)
    answer = Sensor(graph).send_all([START + 700 * PERIOD], gyro=(0.11, 0.0, -0.02))
    assert answer.angular_velocity.x == pytest.approx(0.1, abs=1e-3)
    assert answer.angular_velocity.z == pytest.approx(0.0, abs=1e-3)


def test_there_is_nothing_to_save_without_a_file(graph, sensor):
    sensor.send_all(ticks(3))
    refused = graph.call(Trigger, "fusion/save_calibration")
    assert not refused.success
    assert "calibration_file is empty" in refused.message


def test_the_covariance_is_the_filters_own_and_says_where_north_is_unknown(graph):
    graph.start("fusion")
    sensor = Sensor(graph)
    without = sensor.send_all(ticks(3), mag=None).orientation_covariance
    assert without[8] == pytest.approx(math.pi**2)
    found = sensor.send_all(ticks(400, START + 3 * PERIOD)).orientation_covariance
    assert found[0] == found[4]
    assert math.radians(0.05) ** 2 < found[0] < math.radians(2.0) ** 2
    assert math.radians(1.0) ** 2 < found[8] < math.radians(10.0) ** 2


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_on_a_signal_with_exit_code_0(graph, by):
    fusion = graph.start("fusion")
    graph.until_published("imu/data")
    assert fusion.end(by, timeout=2.0) == 0
    assert "Traceback" not in fusion.said


def test_simulated_time_is_not_needed_for_diagnostics(graph):
    graph.start("fusion", use_sim_time=True)  # and nobody publishes /clock
    heard = graph.hear(DiagnosticArray, "/diagnostics")
    until(lambda: status(heard, "fusion")[0] == b"\x02", "an error about silence")
    assert "No sample on /imu/data_raw yet" in status(heard, "fusion")[1]
    graph.speak(Clock, "/clock", listeners=0)
