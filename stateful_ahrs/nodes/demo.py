"""demo: driver (or bag), fusion and this view as processes that speak DDS."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Quaternion, QuaternionStamped, Vector3Stamped
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64

from ..command import Parser, exit_with_sentence
from ..errors import AhrsError, UsageError
from ..evaluation.live import Tally
from ..recordings.playback import open_bag
from ..recordings.wire import QUATERNION
from ..rotor import Rotor, Vector
from ..words import counted
from . import messages, qos
from .children import Children, own_domain
from .demo_view import View, turns
from .life import fastest_executor

RATE = 200.0  # Hz, of the simulated sensor
MOTION = "tumble"
NEW_ALPHA = 0.99
HIGHEST_ERROR = 1.5  # degrees, at the end, against the simulator's truth
START_UP = 30.0  # s
SILENCE = 4.0  # s without an orientation from the simulated sensor: somebody hangs
WAIT = 10.0  # s, of the bag player for fusion and the demo
LAST_WORDS = 5.0  # s after the end, for the answer about alpha and the last diagnostics


class Source(NamedTuple):
    """Where the samples come from."""

    executable: str
    arguments: list[str]
    title: str
    seconds: float = math.inf
    samples: int | None = None  # of a bag
    truthless: str = ""  # why it tells no truth, if it tells none


class Listener(Node):
    """Hears what fusion publishes, and the truth where somebody tells it."""

    def __init__(self) -> None:
        super().__init__("demo")
        self.tally = Tally()
        self.rpy: Vector = messages.NONE
        self.axis: Vector = messages.NONE
        self.angle = math.nan
        self.fusion: dict[str, str] = {}  # the values of its last diagnostics
        self.fusion_says = ""
        self.diagnosed = -math.inf  # when it did
        self.oriented = -math.inf  # when the last orientation came
        self.missed = "0"  # samples that the driver was too late for
        self.answer = ""
        self.accepted = False
        self._asked: Future | None = None
        self._fusion_parameters = AsyncParameterClient(self, "fusion")
        self._hear(Imu, "imu/data", self._on_orientation)
        self._hear(QuaternionStamped, "ground_truth", self._on_truth)
        self._hear(Vector3Stamped, "imu/rpy", self._on_rpy)
        self._hear(Vector3Stamped, "imu/axis", self._on_axis)
        self._hear(Float64, "imu/angle", self._on_angle)
        self._hear(DiagnosticArray, "/diagnostics", self._on_diagnostics)

    @property
    def error(self) -> float | None:
        """The last known, rad."""
        return self.tally.error

    @property
    def in_effect(self) -> bool:
        """Whether fusion reports the new alpha."""
        return float(self.fusion.get("alpha", "nan")) == NEW_ALPHA

    @property
    def hears_fusion(self) -> bool:
        """Whether its orientations will arrive."""
        return self.count_publishers("imu/data") > 0

    def set_alpha(self) -> None:
        """Ask fusion for the new alpha, once; `answer` is what came of it."""
        if self._asked is None and self._fusion_parameters.services_are_ready():
            self._asked = self._fusion_parameters.set_parameters(
                [Parameter("alpha", value=NEW_ALPHA)]
            )
            self._asked.add_done_callback(self._on_answer)

    def _on_answer(self, future: Future) -> None:
        (result,) = future.result().results
        self.accepted = result.successful
        self.answer = f"set to {NEW_ALPHA}: "
        self.answer += "accepted" if result.successful else f"refused, {result.reason}"

    def _hear(self, kind: type, topic: str, callback: Callable[..., None]) -> None:
        self.create_subscription(kind, topic, callback, qos.SENSOR_SUBSCRIBER)

    def _on_orientation(self, msg: Imu) -> None:
        self.oriented = time.monotonic()
        if msg.orientation_covariance[0] != -1.0:
            self.tally.add(messages.nanoseconds(msg.header.stamp), _rotor(msg.orientation))

    def _on_truth(self, msg: QuaternionStamped) -> None:
        self.tally.add_truth(messages.nanoseconds(msg.header.stamp), _rotor(msg.quaternion))

    def _on_rpy(self, msg: Vector3Stamped) -> None:
        self.rpy = messages.vector(msg.vector)

    def _on_axis(self, msg: Vector3Stamped) -> None:
        self.axis = messages.vector(msg.vector)

    def _on_angle(self, msg: Float64) -> None:
        self.angle = msg.data

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            if status.name.startswith("imu_driver:"):
                self.missed = next((kv.value for kv in status.values if kv.key == "missed"), "0")
            if status.name.startswith("fusion:"):
                values = {pair.key: pair.value for pair in status.values}
                if values["heading"] != self.fusion.get("heading"):
                    self.tally.largest_step = 0.0  # finding north is a step of its own
                self.fusion = values
                self.fusion_says = status.message
                self.diagnosed = time.monotonic()


def _rotor(q: Quaternion) -> Rotor:
    return (q.w, q.x, q.y, q.z)


class Demo:
    """One run."""

    def __init__(self, source: Source, duration: float) -> None:
        self._source = source
        self._duration = duration
        self._simulated = source.samples is None
        self._half = min(duration, source.seconds) / 2.0
        self._bag_ended = False

    def run(self) -> None:
        """Run all processes; `AhrsError` if something did not go well."""
        own_domain()
        with Children() as children:
            children.start("fusion")
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            listener = Listener()
            executor, _ = fastest_executor()
            executor.add_node(listener)
            try:
                with View(self._source.title, self._duration) as view:
                    self._watch(listener, children, view, executor)
            finally:
                executor.shutdown()
                listener.destroy_node()
                rclpy.try_shutdown()
        self._conclude(listener)

    def _watch(
        self, listener: Listener, children: Children, view: View, executor: Executor
    ) -> None:
        """Return at the end of the bag, or of the duration."""
        begin = time.monotonic()
        started = False
        first = end = None
        while True:
            executor.spin_once(timeout_sec=0.05)
            now = time.monotonic()
            if children.ended("fusion"):
                raise AhrsError("fusion has ended before the demo.")
            if not started and (self._simulated or listener.hears_fusion):
                children.start(self._source.executable, *self._source.arguments)
                started = True
            self._bag_ended = started and children.ended(self._source.executable)
            if self._bag_ended and self._simulated:
                raise AhrsError("imu_driver has ended before the demo.")
            if first is None:
                if not listener.tally.samples:
                    self._check_start(now - begin, listener)
                    continue
                first = now
            if self._simulated and now - listener.oriented > SILENCE:
                raise AhrsError(f"no orientation for {SILENCE:g} s: {listener.fusion_says}")
            view.show(listener, now - first)
            if now - first >= self._half:
                listener.set_alpha()
            if end is None and (self._bag_ended or now - first >= self._duration):
                end = now
            if end and (now - end > LAST_WORDS or self._is_complete(listener, end)):
                return

    def _check_start(self, waited: float, listener: Listener) -> None:
        """Raise if there will be no orientation."""
        if self._bag_ended or waited > START_UP:
            why = listener.fusion_says or "fusion is silent."
            raise AhrsError(f"no orientation within {waited:.0f} s: {why}")

    def _is_complete(self, listener: Listener, end: float) -> bool:
        """Whether all is known that the conclusion tells."""
        alpha_known = listener.in_effect if listener.accepted else bool(listener.answer)
        return alpha_known and (not self._bag_ended or listener.diagnosed > end)

    def _conclude(self, listener: Listener) -> None:
        """Print the summary; `AhrsError` if something did not go well."""
        tally, simulated = listener.tally, self._simulated
        if simulated:
            lost = f"{tally.lost} lost; {listener.missed} missed by the driver before"
        elif self._bag_ended:
            arrived = int(listener.fusion.get("imu_samples", 0))
            lost = f"{arrived} of the bag's {self._source.samples} reached fusion"
        else:
            lost = "the bag was not played to its end"
        error = math.nan if tally.error is None else math.degrees(tally.error)
        truth = "the simulator's truth" if simulated else "the bag's ground truth"
        final = f"unknown: {self._why_unknown(tally)}"
        if tally.error is not None:
            final = f"{error:.2f}° against {truth}"
        print(f"orientations  {tally.samples} at {tally.rate:.1f} Hz; {lost}")
        print(f"sign flips    {tally.sign_flips}")
        print(f"largest step  {math.degrees(tally.largest_step):.2f}° from one to the next")
        print(f"turned        {turns(tally.turned)} from the first orientation to the last")
        print(f"alpha         {listener.answer or 'not set'}")
        print(f"final error   {final}")
        sys.stdout.flush()
        faults = []
        if not listener.accepted:
            faults.append(f"alpha {listener.answer or 'was not set: no answer'}")
        elif not listener.in_effect:
            faults.append(f"alpha {NEW_ALPHA} was accepted but is not in effect")
        if tally.sign_flips:
            faults.append(f"the orientation changed its sign {counted(tally.sign_flips, 'time')}")
        if simulated and not error < HIGHEST_ERROR:
            faults.append(f"the final error is {final}, expected below {HIGHEST_ERROR}°")
        if faults:
            raise AhrsError("; ".join(faults) + ".")

    def _why_unknown(self, tally: Tally) -> str:
        """Why there is no error to tell."""
        if self._source.truthless:
            return self._source.truthless
        if tally.truths:
            return f"no orientation has the stamp of any of {counted(tally.truths, 'ground truth')}"
        return "no ground truth came before the end"


def _simulator() -> Source:
    return Source(
        "imu_driver",
        ["--ros-args", "-p", f"rate:={RATE}", "-p", f"sim_motion:={MOTION}"],
        f"simulated MPU-9250 ({MOTION}, {RATE:g} Hz) → imu_driver → DDS → fusion",
    )


def _player(path: Path) -> Source:
    """The bag with its topics where fusion and the demo expect them, and all others aside."""
    with open_bag(path) as bag:
        places = {bag.roles["imu"]: "/imu/data_raw"}
        if "mag" in bag.roles:
            places[bag.roles["mag"]] = "/imu/mag"
        reference = bag.roles.get("reference")
        truthless = ""
        if reference is None:
            truthless = "the bag has no topic ground_truth"
        elif reference.kind == QUATERNION:
            places[reference] = "/ground_truth"
        else:
            truthless = f"the demo reads {QUATERNION}, and the bag has {reference}"
        remaps = ["--ros-args"]
        for topic in bag.topics:
            aside = f"/recorded/{topic.name.lstrip('/')}"
            remaps += ["-r", f"{topic.name}:={places.get(topic, aside)}"]
        return Source(
            "bag_player",
            [str(path), f"--wait={WAIT}", f"--subscribers={len(places)}", *remaps],
            f"{bag.name} → bag_player → DDS → fusion",
            bag.seconds,
            bag.topics[bag.roles["imu"]],
            truthless,
        )


def _demo() -> None:
    parser = Parser(
        prog="demo",
        description="Start a simulated sensor (or a bag) and fusion, watch them, change alpha "
        "half-way, and say how it went. Exit codes: 0 well; 1 not well; 2 usage.",
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=20.0,
        metavar="S",
        help="seconds from the first orientation on (default: %(default)g)",
    )
    parser.add_argument(
        "--bag", type=Path, help="play this bag instead: rosbag2 folder, .mcap, .db3, ROS 1 .bag"
    )
    options = parser.parse_args()
    if not 0.0 < options.duration < math.inf:
        raise UsageError(f"--duration must be above 0 s, got {options.duration:g}.")
    Demo(_player(options.bag) if options.bag else _simulator(), options.duration).run()


def main() -> None:
    """Run the demo."""
    sys.exit(exit_with_sentence("demo", _demo))


if __name__ == "__main__":
    main()
