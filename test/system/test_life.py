"""How nodes start and end, and what they publish for."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

import rclpy
from graph import TIMEOUT, until
from rclpy import event_handler
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from scenarios import TURNS
from sensor_msgs.msg import Imu

from stateful_ahrs.nodes import life, qos
from stateful_ahrs.nodes.children import free_domain


def test_a_node_told_to_end_before_it_was_made_ends_well():
    with life.graph():
        node = Node("early")
        rclpy.shutdown()  # as a signal does
        qos.advertise(node, Imu, "imu/data")
        raise AssertionError("what is shut down publishes nothing")


def test_an_error_while_ros_runs_is_not_swallowed():
    with pytest.raises(RuntimeError, match="of its own"), life.graph():
        raise RuntimeError("an error of its own")


def test_a_node_runs_on_the_plain_executor_where_there_is_no_other(monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy.experimental", None)  # as in an rclpy without it
    never = Future()
    monkeypatch.setattr(life, "Future", lambda: never)
    with life.graph():
        executor, reason = life.fastest_executor()
        node = Node("plain")
        called = []

        def call():
            called.append(1)
            if len(called) == 100:
                rclpy.shutdown()

        node.create_timer(0.001, call)
        life.spin(node)
    assert len(never._callbacks) < 10  # nothing grows with what was called
    assert isinstance(executor, SingleThreadedExecutor)
    assert "this rclpy has no EventsExecutor" in reason


def test_a_message_comes_to_its_callback_past_the_python_of_subscription_and_enum(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(free_domain()))
    heard, modules = [], set()

    def watch(frame, event, _):
        if event == "call":
            modules.add(Path(frame.f_code.co_filename).name)

    def take(message):
        heard.append(message)
        if len(heard) == 1:
            sys.setprofile(watch)
        else:
            sys.setprofile(None)
            rclpy.shutdown()

    with life.graph():
        node = Node("listener")
        listener = node.create_subscription(Imu, "imu/data", take, 10, raw=True)
        publisher = node.create_publisher(Imu, "imu/data", 10)
        node.create_timer(0.01, lambda: publisher.publish(Imu()))
        node.create_timer(TIMEOUT, rclpy.shutdown)
        try:
            life.spin(node)
        finally:
            sys.setprofile(None)
        assert node.destroy_subscription(listener)
    assert isinstance(heard[0], bytes)
    assert "test_life.py" in modules  # or nothing was watched
    assert modules.isdisjoint({"enum.py", "types.py", "subscription.py"})


def test_a_topic_is_wanted_while_someone_listens(graph):
    out = qos.advertise(graph.node, Imu, "imu/data")
    assert not out.wanted
    listener = graph.node.create_subscription(Imu, "imu/data", print, 10)
    until(lambda: out.wanted, "a listener")
    graph.node.destroy_subscription(listener)
    until(lambda: not out.wanted, "its end")


def test_without_word_of_who_listens_a_topic_is_always_wanted(graph, monkeypatch, capfd):
    mute(monkeypatch, "RCL_PUBLISHER_MATCHED")
    out = qos.advertise(graph.node, Imu, "imu/data")
    heard = graph.hear(Imu, "imu/data")
    assert out.wanted
    until(lambda: out.publish(Imu()) or heard, "what is published all the time")
    assert "does not tell who listens" in capfd.readouterr().err


def test_samples_come_where_nobody_tells_of_lost_ones(graph, monkeypatch, capfd):
    mute(monkeypatch, "RCL_SUBSCRIPTION_MESSAGE_LOST")
    heard = []
    qos.subscribe(graph.node, Imu, "imu/data", heard.append, on_lost=print)
    publisher = graph.speak(Imu, "imu/data")
    until(lambda: publisher.publish(Imu()) or heard, "a sample")
    assert "does not tell of samples that it loses" in capfd.readouterr().err


def mute(monkeypatch, kind):
    """Let the middleware have no such event; the one of these tests has all."""
    handler = event_handler.EventHandler

    def make(**arguments):
        if arguments["event_type"].name == kind:
            raise event_handler.UnsupportedEventTypeError("no such event")
        return handler(**arguments)

    monkeypatch.setattr(event_handler, "EventHandler", make)


def test_an_override_is_for_its_own_topic(graph):
    usual = qos.PUBLISHER.depth
    override = Parameter("qos_overrides./first.publisher.depth", value=7)
    node = Node("overridden", context=graph.context, parameter_overrides=[override])
    for topic in ("first", "second"):
        qos.advertise(node, Imu, topic)
    depths = [
        node.get_parameter(f"qos_overrides./{topic}.publisher.depth").value
        for topic in ("first", "second")
    ]
    assert depths == [7, usual]
    node.destroy_node()


def test_a_parameter_that_the_node_does_not_have_is_named_with_the_nearest(graph, tmp_path):
    shared = tmp_path / "shared.yaml"
    shared.write_text(
        "/**: {ros__parameters: {use_sim_time: false, start_type_description_service: true, "
        "transport: sim, qos_overrides: {/imu/data: {publisher: {depth: 5, dept: 5}}}}}"
    )
    arguments = ["-p", "aplha:=0.9", "-p", "alpha:=0.8", "--params-file", str(shared)]
    fusion = graph.start("fusion", "--ros-args", *arguments)
    until(lambda: "ignored" in fusion.said, "the warning")
    _, _, strange = fusion.said.partition("ignored, as fusion has no such parameter: ")
    depth = "qos_overrides./imu/data.publisher.depth"
    assert sorted(strange.splitlines()[0].rstrip(".").split(", ")) == [
        "aplha (perhaps alpha is meant)",
        f"{depth.removesuffix('h')} (perhaps {depth} is meant)",
        "transport",
    ]


def test_the_player_names_them_too(graph):
    pytest.importorskip("rosbags")
    player = graph.start("bag_player", str(TURNS), "--wait", "0", rate=2.0)
    until(lambda: "ignored, as bag_player has no such parameter: rate." in player.said, "it")


@pytest.mark.parametrize("name", ["fusion", "imu_driver"])
def test_a_node_starts_without_what_it_does_not_need(name):
    program = f"import stateful_ahrs.nodes.{name}, sys; print(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    modules = set(ran.stdout.split())
    assert "stateful_ahrs.filters" in modules
    slow = {"numba", "scipy", "rosbags", "rich", "matplotlib", "stateful_ahrs.evaluation"}
    assert modules.isdisjoint(slow)
