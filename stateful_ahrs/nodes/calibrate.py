"""calibrate: a sensor's correction from live topics or a recording, into the driver's YAML."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from array import array
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import Imu, MagneticField, Temperature

from ..command import Parser, exit_with_sentence
from ..errors import UsageError
from ..filters.samples import Array, Stamps
from ..mpu9250 import calibration_file, coverage, fits
from ..mpu9250.burst import STANDARD_GRAVITY
from ..mpu9250.calibration import CalibrationError, Correction
from ..recordings import load
from ..recordings.opening import BAGS
from ..recordings.progress import bar
from ..recordings.temperature import temperature
from ..words import counted
from . import messages, qos
from .calibrate_view import View, described, result
from .life import fastest_executor, graph, one_line, own_arguments
from .parameters import warn_of_unknown

LOOK = 0.5  # s between two looks at what there is
NAP = 0.05  # s
FIRST = 15.0  # s without a first sample
SILENT = 5.0  # s after the last: there will be no more
ANSWER = 5.0  # s for the driver to say what it applies
INSTRUCTIONS = {
    "gyro": "lay the sensor down and do not touch it for 5 s.",
    "accel": "hold the sensor still for a second on each of its six sides; tilted positions "
    "between them, nine or more in all (--positions), also find misaligned axes.",
    "mag": "turn the sensor slowly about all its axes, upside down too, in one place away from "
    "iron.",
}
EPILOG = """\
The correction replaces the sensor's own in FILE; those of the other sensors are kept. The data
must be raw: from a driver that runs without calibration_file. Ctrl-C ends with the samples that
are there. Exit codes: 0 written; 1 the data support no calibration, or a file cannot be used;
2 usage."""


@dataclass
class Data:
    """What is known of the sensor so far."""

    imu_stamps: array[int] = field(default_factory=lambda: array("q"))  # ns
    imu: array[float] = field(default_factory=lambda: array("d"))  # rad/s and m/s², six a sample
    mag: array[float] = field(default_factory=lambda: array("d"))  # tesla, three a sample
    temperatures: array[float] = field(default_factory=lambda: array("d"))  # °C
    sensor: str = ""
    topic: str = ""  # that they come from, if live
    publishers: int = 0  # of that topic, when it was last asked

    @property
    def stamps(self) -> Stamps:
        """Stamps (n,) ns."""
        return np.array(self.imu_stamps, dtype=np.int64)

    @property
    def rates(self) -> Array:
        """Rates (n, 3) rad/s."""
        return np.array(self.imu).reshape(-1, 6)[:, :3]

    @property
    def forces(self) -> Array:
        """Specific force (n, 3) m/s²."""
        return np.array(self.imu).reshape(-1, 6)[:, 3:]

    @property
    def fields(self) -> Array:
        """Magnetic field (k, 3) tesla."""
        return np.array(self.mag).reshape(-1, 3)

    @property
    def temperature(self) -> float | None:
        """Mean, °C."""
        told = [value for value in self.temperatures if math.isfinite(value)]
        return sum(told) / len(told) if told else None


class Listener(Node):
    """Takes the samples of one sensor from its topics."""

    def __init__(self, job: argparse.Namespace, data: Data) -> None:
        super().__init__("calibrate", start_parameter_services=False)
        self.data = data
        self.samples = 0
        self.heard = time.monotonic()  # when the last sample came
        if job.sensor_kind == "mag":
            samples = self._subscribe(MagneticField, job.mag, self._on_mag)
        else:
            samples = self._subscribe(Imu, job.imu, self._on_imu)
            self._subscribe(Temperature, job.temperature, self._on_temperature)
        data.topic = samples.topic_name

    def _subscribe(self, kind: type, topic: str, callback: Any) -> Any:
        try:
            return self.create_subscription(kind, topic, callback, qos.SENSOR_SUBSCRIBER)
        except Exception as error:
            if not self.context.ok():  # told to end meanwhile
                raise
            raise UsageError(f"{topic!r} is no topic: {one_line(error)}") from None

    def _on_imu(self, msg: Imu) -> None:
        gyro, accel = messages.rates_and_force(msg)
        self.data.imu_stamps.append(self._took(msg))
        self.data.imu.extend((*gyro, *accel))

    def _on_mag(self, msg: MagneticField) -> None:
        self._took(msg)
        mag = messages.reported(msg.magnetic_field, msg.magnetic_field_covariance)
        self.data.mag.extend(mag)

    def _on_temperature(self, msg: Temperature) -> None:
        self.data.temperatures.append(msg.temperature)

    def _took(self, msg: Any) -> int:
        self.samples += 1
        self.heard = time.monotonic()
        self.data.sensor = msg.header.frame_id
        return messages.nanoseconds(msg.header.stamp) or time.time_ns()


def fit(kind: str, data: Data, gravity: float) -> Correction:
    """The correction, dated now; `CalibrationError` where the data carry none."""
    if kind == "gyro":
        return fits.fit_gyro(data.stamps, data.rates, data.forces, data.temperature)
    if kind == "accel":
        found = fits.fit_accel(data.stamps, data.rates, data.forces, gravity)
        return replace(found, temperature=data.temperature and round(data.temperature, 2))
    return fits.fit_mag(data.fields)


def recorded(job: argparse.Namespace) -> Data:
    """The samples of a recording."""
    with bar(f"reading {job.bag.name}") as progress:
        recording = load(job.bag, progress=progress)
    if job.sensor_kind == "mag" and not len(recording.mag):
        raise CalibrationError(
            f"{job.bag.name} has no magnetometer samples; left out are: "
            f"{', '.join(recording.left_out) or 'none'}."
        )
    data = Data(sensor=recording.name)
    data.imu_stamps.frombytes(recording.stamps.astype(np.int64).tobytes())
    data.imu.frombytes(np.hstack([recording.gyro, recording.accel]).tobytes())
    data.mag.frombytes(np.ascontiguousarray(recording.mag).tobytes())
    if job.sensor_kind != "mag" and (job.bag.is_dir() or job.bag.suffix in BAGS):
        told = temperature(job.bag)
        data.temperatures.extend([] if told is None else [told])
    return data


def listened(job: argparse.Namespace) -> Data:
    """The samples of the live topics, when they are enough or the user ends it."""
    data = Data(topic=job.mag if job.sensor_kind == "mag" else job.imu)
    with graph():
        listener = Listener(job, data)
        warn_of_unknown(listener)
        executor, _ = fastest_executor()
        executor.add_node(listener)
        try:
            _await_first(listener, executor)
            if listener.samples:
                _refuse_calibrated(listener, executor)
                with View(f"calibrate {job.sensor_kind}", INSTRUCTIONS[job.sensor_kind]) as view:
                    _collect(job, listener, executor, view)
        finally:
            executor.shutdown()
            listener.destroy_node()
    if not (data.imu or data.mag):
        raise CalibrationError(
            f"no sample on {data.topic} ({counted(data.publishers, 'publisher')}). Start the "
            "driver, or name the topic (--imu, --mag)."
        )
    return data


def _spin(executor: Executor) -> None:
    """Take what has come; return soon."""
    with suppress(ExternalShutdownException):
        executor.spin_once(timeout_sec=NAP)


def _await_first(listener: Listener, executor: Executor) -> None:
    """Wait for a sample, but not for ever."""
    data, end = listener.data, time.monotonic() + FIRST
    while rclpy.ok() and not listener.samples and time.monotonic() < end:
        data.publishers = listener.count_publishers(data.topic)
        _spin(executor)


def _publishers(listener: Listener, executor: Executor, end: float) -> list[str]:
    """Full names of the nodes that publish the topic, as soon as they are known."""
    while rclpy.ok():
        infos = listener.get_publishers_info_by_topic(listener.data.topic)
        named = [
            info for info in infos if not info.node_name.startswith("_")
        ]  # _NODE_NAME_UNKNOWN_
        if (infos and len(named) == len(infos)) or time.monotonic() > end:
            return [f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in named]
        _spin(executor)
    return []


def _refuse_calibrated(listener: Listener, executor: Executor) -> None:
    """Raise `CalibrationError` if a node that publishes says that it applies a calibration."""
    end = time.monotonic() + ANSWER
    for name in _publishers(listener, executor, end):
        client = listener.create_client(GetParameters, f"{name}/get_parameters")
        while rclpy.ok() and not client.service_is_ready() and time.monotonic() < end:
            _spin(executor)
        if not (rclpy.ok() and client.service_is_ready()):
            continue
        future = client.call_async(GetParameters.Request(names=["calibration_file"]))
        while rclpy.ok() and not future.done() and time.monotonic() < end:
            _spin(executor)
        values = future.result().values if future.done() else []
        if values and values[0].string_value:
            raise CalibrationError(
                f"{name} corrects its data by {values[0].string_value}, expected raw data: start "
                "it without calibration_file."
            )


def _collect(job: argparse.Namespace, listener: Listener, executor: Executor, view: View) -> None:
    """Return when the samples are enough, none come any more, or the user has had enough."""
    begin = time.monotonic()
    look = begin + LOOK
    while rclpy.ok():
        _spin(executor)
        now = time.monotonic()
        if now < look:
            continue
        if now - listener.heard > SILENT:
            return
        enough, state = False, ""
        try:
            correction = fit(job.sensor_kind, listener.data, job.gravity)
        except CalibrationError as error:
            state = str(error)
        else:
            enough = fits.is_enough(correction, job.positions)
            state = f"{described(correction)}; {'enough.' if enough else 'good, more is better.'}"
        cells = here = None
        if job.sensor_kind != "gyro":
            mag = job.sensor_kind == "mag"
            points = listener.data.fields if mag else listener.data.forces
            pointed = fits.directions(job.sensor_kind, points)
            cells, here = coverage.cells(pointed), coverage.cells(pointed[-1:])
        view.show(now - begin, listener.samples, cells, here, state)
        if enough:
            return
        look = time.monotonic() + LOOK


def _job(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="calibrate",
        description="Find what corrects a sensor, from live topics or from a recording.",
        epilog=EPILOG,
    )
    parser.add_argument("sensor_kind", choices=list(INSTRUCTIONS), metavar="gyro|accel|mag")
    parser.add_argument(
        "--bag",
        type=Path,
        metavar="PATH",
        help="a recording instead of live topics: all that `evaluate` reads",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("calibration.yaml"),
        metavar="FILE",
        help="default: %(default)s",
    )
    for name, topic in (("imu", "imu/data_raw"), ("mag", "imu/mag")):
        parser.add_argument(f"--{name}", metavar="TOPIC", help=f"live topic (default: {topic})")
    parser.add_argument("--sensor", metavar="NAME", help="noted in the file (default: its frame)")
    parser.add_argument(
        "--gravity",
        type=float,
        default=STANDARD_GRAVITY,
        metavar="M/S2",
        help="of the place, 9.78 to 9.83, for the accelerometer's scale (default: %(default)g)",
    )
    parser.add_argument(
        "--positions",
        type=int,
        default=len(coverage.FACES),
        metavar="N",
        help="accel, live: end at so many positions (default: %(default)s)",
    )
    job = parser.parse_args(own_arguments(["calibrate", *argv])[1:])
    if not 9.7 < job.gravity < 9.9:
        raise UsageError(f"--gravity must be between 9.7 and 9.9 m/s², got {job.gravity:g}.")
    if job.positions < len(coverage.FACES):
        raise UsageError(f"--positions must be 6 or more, got {job.positions}.")
    if job.bag and (job.imu or job.mag):
        raise UsageError("--imu and --mag name live topics; with --bag the recording is searched.")
    job.imu, job.mag = job.imu or "imu/data_raw", job.mag or "imu/mag"
    job.temperature = "imu/temperature"
    return job


def _calibrate(argv: Sequence[str]) -> None:
    job = _job(argv)
    if job.output.is_dir() or not job.output.parent.is_dir():
        raise UsageError(f"--output {job.output} is no place for a file.")
    if not os.access(job.output.parent, os.W_OK):
        raise UsageError(f"--output {job.output}: you may not write into that folder.")
    before = calibration_file.merged(job.output, "")  # what is wrong with it, at once
    data = recorded(job) if job.bag else listened(job)
    correction = fit(job.sensor_kind, data, job.gravity)
    sensor = job.sensor or before.sensor or data.sensor
    whole = calibration_file.merged(job.output, sensor, **{job.sensor_kind: correction})
    calibration_file.save(whole, job.output)
    print(f"{job.sensor_kind}: {result(job.sensor_kind, correction)}")
    print(f"written to {job.output}; the driver loads it: -p calibration_file:={job.output}")


def main() -> None:
    """Calibrate one sensor."""
    sys.exit(exit_with_sentence("calibrate", lambda: _calibrate(sys.argv[1:])))


if __name__ == "__main__":
    main()
