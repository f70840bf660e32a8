"""fusion: imu/data_raw and imu/mag in, one continuous orientation out."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import asdict, fields, replace
from typing import Any

from geometry_msgs.msg import TransformStamped, Vector3Stamped
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from .. import filters, rotor
from ..errors import AhrsError, UsageError
from ..filters.certainty import stddevs
from ..filters.frames import WorldFrame
from ..filters.pairing import Pairing
from ..filters.rest import MovedError, RestWindow
from ..filters.settings import NOTHING, Known
from ..filters.stamps import StampGate
from ..mpu9250 import calibration_file
from ..rotor import Rotor, Vector
from ..words import counted
from . import lane, life, messages, qos
from .diagnostics import ERROR, OK, WARN, Diagnostics, Once, Status
from .parameters import Parameters, Spec

ZERO: Vector = (0.0, 0.0, 0.0)
REPORTED = len(fields(filters.Report))  # what follows in a report is the filter's own
SILENT = 1.0  # s without a sample before /diagnostics says so

PARAMETERS = [
    Spec("filter", "stateful", f"one of {', '.join(filters.FILTERS)}"),
    Spec(
        "alpha",
        0.9967,
        "weight of the gyroscope path over 1/alpha_rate seconds",
        live=True,
        limits=(0.0, 1.0),
    ),
    Spec(
        "alpha_rate",
        100.0,
        "Hz; 0: alpha applies to each sample, as in the paper",
        live=True,
        limits=(0.0, 1e6),
    ),
    Spec(
        "alpha_heading",
        -1.0,
        "the same for heading; negative: as fast as the filter finds right, or as alpha",
        live=True,
        limits=(-1.0, 1.0),
    ),
    Spec(
        "stateful",
        True,
        "false: snapshots keep their own sign, the paper's failing baseline",
        live=True,
    ),
    Spec("use_mag", True, "false: heading follows the gyroscope", live=True),
    Spec("despike", True, "take back single samples that no neighbour confirms", live=True),
    Spec("low_pass", True, "of the acceleration, where gravity stands still", live=True),
    Spec("learn_bias", True, "of the gyroscope; false keeps what is known", live=True),
    Spec("learn_misalignment", True, "of the gyroscope's axes, likewise", live=True),
    Spec("learn_mag", True, "the magnetometer's delay and hard iron, likewise", live=True),
    Spec("weigh_mag", True, "trust a changed magnetic field the less", live=True),
    Spec("normalise", True, "the rotor after each blend", live=True),
    Spec("average_start", True, "begin with a mean of all samples", live=True),
    Spec("calibration_file", "", "YAML with what was learned; ~/save_calibration writes it"),
    Spec("world_frame", "enu", "enu, nwu or ned: axes of the frame that orientation is given in"),
    Spec("magnetic_declination", 0.0, "rad, from true to magnetic north, east positive"),
    Spec(
        "orientation_stddev",
        -1.0,
        "rad, for the covariance of the orientation; negative: the filter's own",
        live=True,
    ),
    lane.FAST_LANE,
    Spec("publish_tf", False, "broadcast the orientation on /tf (needs tf2_ros)"),
    Spec("tf_parent", "map", "parent frame of that transform"),
]


SWITCHES = (
    "alpha_heading",
    "stateful",
    "use_mag",
    "despike",
    "low_pass",
    "learn_bias",
    "learn_misalignment",
    "learn_mag",
    "weigh_mag",
    "normalise",
    "average_start",
)  # parameters that are settings as they are


class Fusion(Node):
    """Translates between topics and a filter of the registry."""

    def __init__(self) -> None:
        super().__init__("fusion")
        self._known = NOTHING
        self._chosen = Parameters(self, PARAMETERS, accept=self._settings, apply=self._apply)
        values = self._chosen.values
        self._lane = lane.choose(values["fast_lane"])
        self._unknown = self._lane.covariance(messages.UNKNOWN)
        self._world = WorldFrame(values["world_frame"], values["magnetic_declination"])
        self._known = self._load(values["calibration_file"])
        self._filter = filters.make(values["filter"], self._settings(values))
        self._apply(values)
        self._uses_alpha = self._filter.uses_alpha
        self._gate = StampGate()
        self._pairing = Pairing()
        self._rest = RestWindow()
        self._turn = rotor.Turn()
        self._bias = self._calibrated = ZERO
        self._orientation: Rotor = rotor.IDENTITY
        self._once = Once(self)
        self._imu_count = self._mag_count = 0
        self._imu_count_before = self._mag_count_before = 0
        self._imu_arrival = self._mag_arrival = -math.inf
        self._reported = self._filter.report
        self._mag_empty = self._mag_unstamped = self._lost = 0

        raw = self._lane.raw
        self._imu_out = qos.advertise(self, Imu, "imu/data", raw=raw)
        self._axis_out = qos.advertise(self, Vector3Stamped, "imu/axis", raw=raw)
        self._angle_out = qos.advertise(self, Float64, "imu/angle", raw=raw)
        self._rpy_out = qos.advertise(self, Vector3Stamped, "imu/rpy", raw=raw)
        self._broadcaster = self._transform_broadcaster() if values["publish_tf"] else None
        self._mag_in = self._subscribe(MagneticField, "imu/mag", self._on_mag)
        self._imu_in = self._subscribe(Imu, "imu/data_raw", self._on_imu)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/calibrate_gyro", self._on_calibrate_gyro)
        self.create_service(Trigger, "~/save_calibration", self._on_save_calibration)
        self._jump_handle = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False
            ),
            post_callback=self._on_clock_jump,
        )
        self._diagnostics = Diagnostics(self, "orientation", self._status)
        self.get_logger().info(
            f"filter {values['filter']}, alpha {values['alpha']}, world frame "
            f"{values['world_frame']}: {self._imu_in.topic_name} and {self._mag_in.topic_name} "
            f"→ {self._imu_out.topic_name}"
        )

    # Parameters

    def _settings(self, values: dict[str, Any]) -> filters.Settings:
        """The filter's settings; an `AhrsError` if the values make none."""
        if not -math.inf < values["orientation_stddev"] < math.inf:
            raise UsageError(
                f"orientation_stddev must be finite, in rad, or negative for the filter's own, "
                f"got {values['orientation_stddev']}."
            )
        world = WorldFrame(values["world_frame"], values["magnetic_declination"])
        return filters.Settings(
            alpha=values["alpha"],
            alpha_rate=values["alpha_rate"],
            north_at_start=world.north_at_zero_yaw,
            known=self._known,
            **{name: values[name] for name in SWITCHES},
        )

    def _apply(self, values: dict[str, Any]) -> None:
        """Take new values from the next sample on."""
        self._filter.settings = self._settings(values)
        self._chosen_stddev = values["orientation_stddev"]
        self._covariance_of: object = None

    def _orientation_covariance(self) -> Any:
        """About the axes of the earth frame: x and y are tilt, z is heading."""
        own = self._filter.stddev
        told = own or self._filter.heading_known
        if told != self._covariance_of:
            self._covariance_of = told
            known = own[1] < math.inf if own else bool(told)
            stddev = stddevs(own, known, self._chosen_stddev)
            self._covariance = self._lane.covariance(messages.about_the_vertical(*stddev))
        return self._covariance

    def _load(self, path: str) -> Known:
        """What an earlier run learned; nothing as long as there is no file."""
        if not path:
            return NOTHING
        if not calibration_file.exists(path):
            self.get_logger().info(f"{path} does not exist yet: ~/save_calibration writes it.")
            return NOTHING
        return calibration_file.load(path).learned

    # Samples in

    def _subscribe(self, kind: type, topic: str, callback: Any) -> Any:
        return qos.subscribe(self, kind, topic, callback, self._on_lost, raw=self._lane.raw)

    def _on_imu(self, message: Any) -> None:
        self._imu_count += 1
        self._imu_arrival = time.monotonic()
        sample = self._lane.inertial(message)
        if sample is None:
            return
        stamp, gyro, accel, message = sample
        gate = self._gate
        dt = gate.step(stamp, self._now() if stamp == 0 else 0)
        if gate.news:
            self._once.warn(*gate.news)
        if dt is None:
            return
        if stamp != gate.last:
            stamp = gate.last
            message = self._lane.stamped(message, stamp)
        if dt == 0.0:
            self._pairing.restart(stamp)
        self._rest.add(gyro, dt)
        if self._bias != ZERO:
            gyro = rotor.minus(gyro, self._bias)
        mag = self._pairing.take(stamp)
        if mag is not None:
            self._filter.update_mag(mag)
        attitude = self._filter.update_imu(gyro, accel, dt)
        started = self._filter.started
        if started:
            self._orientation = self._world.update(attitude)
        try:
            if self._imu_out.wanted:
                self._publish(message, rotor.minus(gyro, self._filter.bias), accel, started)
            if started:
                self._publish_derived(message, stamp)
        except RuntimeError:
            if self.context.ok():
                raise  # else ROS was shut down since the sample came

    def _on_mag(self, message: Any) -> None:
        self._mag_count += 1
        self._mag_arrival = time.monotonic()
        sample = self._lane.magnetic(message)
        if sample is None:
            return
        stamp, mag = sample
        if not messages.finite(mag):
            self._mag_empty += 1
            return
        if stamp == 0:
            self._mag_unstamped += 1
            stamp = self._gate.last + 1  # it belongs to the next inertial sample
        if self._pairing.add(stamp, mag):
            self._filter.amend_mag(mag)

    def _on_lost(self, event: Any) -> None:
        self._lost += event.total_count_change
        self._once.warn("lost", "The middleware lost samples before they arrived.")

    def _on_clock_jump(self, jump: TimeJump) -> None:
        self._gate.clock_jumped()
        self._once.warn(
            "clock", f"The clock jumped back by {-jump.delta.nanoseconds * 1e-9:.3f} s."
        )

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds

    # Orientation out

    def _publish(self, message: Any, gyro: Vector, accel: Vector, started: bool) -> None:
        """Publish imu/data: the sample, its rates less the bias, with the orientation."""
        if not math.isfinite(sum(gyro) + sum(accel)):
            if not messages.finite(gyro):
                gyro, message = ZERO, self._lane.without_rates(message)
            if not messages.finite(accel):
                message = self._lane.without_force(message)
        if started:
            orientation, covariance = self._orientation, self._orientation_covariance()
        else:
            orientation, covariance = rotor.IDENTITY, self._unknown
        self._imu_out.publish(self._lane.oriented(message, orientation, covariance, gyro))

    def _publish_derived(self, message: Any, stamp: int) -> None:
        """Publish what is computed from the orientation only while someone listens."""
        axis_wanted, angle_wanted = self._axis_out.wanted, self._angle_out.wanted
        self._turn.update(self._orientation, coarse=not (axis_wanted or angle_wanted))
        if axis_wanted:
            frame = self._lane.frame_of(message)
            self._axis_out.publish(self._lane.vector(stamp, frame, self._turn.axis))
        if angle_wanted:
            self._angle_out.publish(self._lane.number(self._turn.angle))
        if self._rpy_out.wanted:
            frame, rpy = self._lane.frame_of(message), rotor.euler(self._orientation)
            self._rpy_out.publish(self._lane.vector(stamp, frame, rpy))
        if self._broadcaster is not None:
            transform = TransformStamped(
                header=messages.header(stamp, self._chosen["tf_parent"]),
                child_frame_id=self._lane.name(self._lane.frame_of(message)),
            )
            transform.transform.rotation = messages.quaternion_message(self._orientation)
            self._broadcaster.sendTransform(transform)

    def _transform_broadcaster(self) -> Any:
        try:
            from tf2_ros import TransformBroadcaster
        except ImportError:
            raise UsageError(
                "publish_tf needs tf2_ros, which this Python does not have: install "
                "ros-jazzy-tf2-ros-py and source the ROS environment, or set publish_tf to false."
            ) from None
        return TransformBroadcaster(self)

    # Services and diagnostics

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._filter.reset()
        self._bias = self._calibrated
        self._turn = rotor.Turn()
        response.success = True
        response.message = "The filter starts anew with the next sample."
        return response

    def _on_calibrate_gyro(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            bias = self._rest.bias()
        except MovedError as error:
            response.success, response.message = False, str(error)
            return response
        self._calibrated = bias
        self._bias = rotor.minus(bias, self._filter.bias)  # the filter takes what it learned
        response.success = True
        response.message = "bias " + " ".join(f"{value:+.6f}" for value in bias) + " rad/s"
        return response

    def _on_save_calibration(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        path = self._chosen["calibration_file"]
        known = self._filter.known
        try:
            if not path:
                raise UsageError("calibration_file is empty: start fusion with the file to write.")
            if not self._filter.started:
                raise UsageError("no usable sample yet: nothing has been learned.")
            if known is None:
                raise UsageError(f"filter {self._chosen['filter']} learns nothing of the sensors.")
            known = replace(known, bias=rotor.total(known.bias, self._bias))
            calibration_file.save_learned(path, known)
        except AhrsError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.message = f"{path}: what was learned; fusion starts from it the next time."
        return response

    def _status(self, elapsed: float) -> Status:
        now = time.monotonic()
        report = self._filter.report
        settings = self._filter.settings
        if report.started:
            self._turn.update(self._orientation)
        imu_age, mag_age = now - self._imu_arrival, now - self._mag_arrival
        values: dict[str, object] = {
            "filter": self._chosen["filter"],
            "alpha": settings.alpha if self._uses_alpha else "not used",
            "time_constant_s": settings.time_constant if self._uses_alpha else "not used",
            "stateful": settings.stateful,
            "angle_rad": self._turn.angle,
            "axis": " ".join(f"{value:.4f}" for value in self._turn.axis),
            "imu_rate_hz": (self._imu_count - self._imu_count_before) / elapsed,
            "mag_rate_hz": (self._mag_count - self._mag_count_before) / elapsed,
            "imu_samples": self._imu_count,
            "mag_samples": self._mag_count,
            "imu_age_s": imu_age,
            "mag_age_s": mag_age,
            "heading": "magnetometer"
            if report.heading_from_mag and mag_age <= SILENT
            else "gyroscope",
            "gyro_bias_rad_s": " ".join(
                f"{value:.6f}" for value in rotor.total(self._bias, self._filter.bias)
            ),
            "calibration_file": self._chosen["calibration_file"],
            "sign_corrections": report.sign_corrections,
            "gyro_rejected": report.gyro_rejected,
            "accel_rejected": report.accel_rejected,
            "mag_rejected": report.mag_rejected,
            **{own.name: getattr(report, own.name) for own in fields(report)[REPORTED:]},
            "mag_empty": self._mag_empty,
            "mag_unstamped": self._mag_unstamped,
            "mag_superseded": self._pairing.superseded,
            "mag_late": self._pairing.late,
            "lost_in_transport": self._lost,
            "malformed": self._lane.malformed,
            "left_the_fast_lane": self._lane.slow,
            **{f"stamps_{name}": count for name, count in asdict(self._gate.counts).items()},
        }
        samples = self._imu_count - self._imu_count_before
        rejected = {
            "gyroscope": report.gyro_rejected - self._reported.gyro_rejected,
            "accelerometer": report.accel_rejected - self._reported.accel_rejected,
        }
        self._imu_count_before, self._mag_count_before = self._imu_count, self._mag_count
        self._reported = report
        if imu_age > SILENT:
            return ERROR, self._silence(self._imu_in.topic_name, imu_age), values
        for topic in (self._imu_in.topic_name, self._mag_in.topic_name):
            if (publishers := self.count_publishers(topic)) > 1:
                mixed = f"{publishers} publishers on {topic}: sensors are mixed"
                return WARN, f"{mixed}, unless one has just crashed.", values
        if not report.started:
            return ERROR, "No usable accelerometer sample yet: orientation unknown.", values
        for sensor, count in rejected.items():
            if 2 * count > samples > 0:
                last = counted(samples, f"{sensor} sample")
                return WARN, f"Of the last {last}, {count} were rejected.", values
        if not settings.use_mag:
            return OK, "Six axes by choice: heading follows the gyroscope.", values
        if mag_age > SILENT:
            what = self._silence(self._mag_in.topic_name, mag_age)
            return WARN, f"{what} Heading follows the gyroscope.", values
        if getattr(report, "mag_trust", 1.0) <= filters.DISTURBED:
            return WARN, "The magnetic field is disturbed: heading follows the gyroscope.", values
        if not report.heading_from_mag:
            return WARN, "No usable magnetometer sample: heading follows the gyroscope.", values
        return OK, "Orientation from nine axes.", values

    def _silence(self, topic: str, age: float) -> str:
        publishers = self.count_publishers(topic)
        since = "yet" if math.isinf(age) else f"for {age:.0f} s"
        return f"No sample on {topic} {since} ({counted(publishers, 'publisher')})."


def main() -> None:
    """Run the node."""
    sys.exit(life.run("fusion", Fusion, PARAMETERS))


if __name__ == "__main__":
    main()
