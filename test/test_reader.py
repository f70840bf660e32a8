"""The reader goes on whatever happens to the device; real time, a simulated chip."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

import pytest
from faulty import FaultyBus

from stateful_ahrs.mpu9250 import reader as module
from stateful_ahrs.mpu9250.burst import Reading
from stateful_ahrs.mpu9250.chip import Settings
from stateful_ahrs.mpu9250.chip_source import ChipSource
from stateful_ahrs.mpu9250.monitor import Level
from stateful_ahrs.mpu9250.motion import motion
from stateful_ahrs.mpu9250.reader import Reader
from stateful_ahrs.mpu9250.simulator import SimulatedMpu9250

PATIENCE = 20.0  # s; a loaded machine is slow


class Desk:
    """A reader at work, and what it reported."""

    def __init__(self, settings: Settings) -> None:
        self.sim = SimulatedMpu9250(motion("tumble"))
        self.bus = FaultyBus(self.sim)
        self.opened: list[float] = []
        self.readings: list[tuple[Reading, int, int]] = []
        self.source = ChipSource(self._open, settings)
        self.source.open()
        self.reader = Reader(self.source, self._on_reading)

    def _open(self) -> FaultyBus:
        self.opened.append(time.monotonic())
        return self.bus

    def _on_reading(self, reading: Reading, stamp: int) -> None:
        self.readings.append((reading, stamp, time.time_ns()))

    def until(self, condition: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end
            time.sleep(0.002)

    def until_lost(self) -> str:
        """Wait for a loss; its sentence."""
        self.until(lambda: self.reader.lost)
        return str(self.reader.lost)

    def until_well(self) -> None:
        self.until(lambda: not self.reader.lost)

    @property
    def losses(self) -> object:
        return self.reader.verdict(1.0)[2]["losses"]

    def more(self, count: int) -> None:
        """Wait for so many further readings."""
        enough = len(self.readings) + count
        self.until(lambda: len(self.readings) >= enough)

    @property
    def stamps(self) -> list[int]:
        return [stamp for _, stamp, _ in self.readings]


@contextmanager
def working(settings: Settings = Settings(200.0)) -> Iterator[Desk]:
    desk = Desk(settings)
    desk.reader.start()
    try:
        desk.more(20)
        yield desk
    finally:
        desk.reader.end()


MODES = pytest.mark.parametrize(
    "settings", [Settings(200.0), Settings(1000.0, fifo=True)], ids=["poll", "fifo"]
)


@MODES
def test_stamps_are_the_time_at_which_samples_were_taken(settings: Settings):
    with working(settings) as desk:
        desk.more(150)
    assert all(a < b for a, b in pairwise(desk.stamps))
    youngest = min(now - stamp for _, stamp, now in desk.readings[100:])  # the others waited
    # a FIFO's last is at most a period old, and its least is the map
    assert -2_000_000 < youngest < 10_000_000


@MODES
def test_a_device_that_goes_and_comes_goes_on_in_time(settings: Settings):
    with working(settings) as desk:
        desk.bus.unplugged = True
        assert "no device answers" in desk.until_lost()
        assert desk.reader.verdict(1.0)[0] is Level.ERROR
        gone, tries = len(desk.readings), len(desk.opened)
        desk.until(lambda: len(desk.opened) >= tries + 2)
        desk.bus.unplugged = False
        desk.sim.power_cycle()
        desk.until_well()
        desk.more(20)
        assert desk.reader.verdict(1.0)[0] is not Level.ERROR
        assert desk.losses == 1
        back = desk.readings[gone:]
    assert all(a < b for a, b in pairwise(desk.stamps))
    assert back[0][1] == pytest.approx(back[0][2], abs=500_000_000)  # now, not where it was left
    assert back[0][0].accel[2] != 0.0


def test_pauses_between_tries_grow(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "LONGEST_PAUSE", 0.4)
    with working() as desk:
        desk.bus.unplugged = True
        desk.until(lambda: len(desk.opened) >= 7)
        assert desk.losses == 1
    pauses = [b - a for a, b in pairwise(desk.opened[1:7])]
    for pause, least in zip(pauses, (0.2, 0.4, 0.4, 0.4, 0.4), strict=True):
        assert least <= pause
    assert pauses[-1] < 1.6  # half of what it would have grown to


def test_frozen_data_is_a_loss_and_none_of_it_is_passed_on_until_it_changes():
    with working() as desk:
        desk.bus.frozen = True
        assert "the same counts" in desk.until_lost()
        frozen = len(desk.readings)
        desk.until(lambda: len(desk.opened) >= 3)
        assert len(desk.readings) == frozen
        desk.bus.frozen = False
        desk.until_well()
        assert desk.losses == 1
    assert len({(r.gyro, r.accel) for r, _, _ in desk.readings[:frozen]}) > frozen - 60


@pytest.mark.parametrize("fault", ["stuck", "power"])
def test_a_stuck_bus_and_a_brown_out_end_by_themselves(fault: str):
    with working() as desk:
        if fault == "stuck":
            desk.bus.stuck = True
        else:
            desk.sim.power_cycle()
        desk.until_lost()
        desk.bus.stuck = False
        desk.until_well()
        begin = len(desk.readings)
        desk.more(50)
    assert any(reading.mag is not None for reading, _, _ in desk.readings[begin:])
    assert all(a < b for a, b in pairwise(desk.stamps))


@pytest.mark.parametrize("state", ["well", "lost", "slow"])
def test_it_ends_in_any_state(state: str):
    with working() as desk:
        if state == "lost":
            desk.bus.unplugged = True
            desk.until_lost()
        elif state == "slow":
            desk.bus.latency = 0.1
        desk.reader.end()
        desk.reader.join(PATIENCE)
        assert not desk.reader.is_alive()


def test_jitter_and_clocks_are_reported():
    with working() as desk:
        desk.more(100)
        _, _, values = desk.reader.verdict(1.0)
    assert 0.0 < values["stamp_jitter_ms"] <= values["stamp_jitter_largest_ms"]
    assert values["device_clock_restarts"] == values["host_clock_steps"] == 0
