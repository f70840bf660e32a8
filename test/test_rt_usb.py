"""RT's module in both formats: values, numbering, damage."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import pytest
from boards import RtUsbBinary, RtUsbText
from hypothesis import given
from hypothesis import strategies as st
from streams import COUNT, bytewise, differ, fed, meant, sampled, stream

from stateful_ahrs.mpu9250.protocols import Parser
from stateful_ahrs.mpu9250.rt_usb import RtUsbBinaryParser, RtUsbTextParser

SIZE = 28
GOLDEN = Path(__file__).parent / "golden"
FORMATS = [(RtUsbText(), RtUsbTextParser, 1), (RtUsbBinary(), RtUsbBinaryParser, 0)]
BOTH = pytest.mark.parametrize(("board", "make", "first"), FORMATS, ids=["text", "binary"])
LIMIT = 0.1  # counts at ±2 g and ±2000 °/s: 1998 °/s of 2000, six decimals, the adjusted mag


def agree(records: list, first: int) -> None:
    expected = meant(RtUsbText.settings)[first:]
    assert len(records) == len(expected)
    for record, reading in zip(records, expected, strict=True):
        assert record.clock is None
        # the board's 16.4 counts for 16.384, and the magnetometer adjusted to whole counts
        assert record.reading.gyro == pytest.approx(reading.gyro, rel=1.1e-3, abs=5e-6)
        assert record.reading.accel == pytest.approx(reading.accel, abs=1e-5)
        assert record.reading.temperature == pytest.approx(reading.temperature, abs=1e-5)
        assert record.reading.mag == pytest.approx(reading.mag, abs=0.16e-6)
        assert differ(record.reading, reading) < 40.0


@BOTH
def test_records_are_what_the_chip_measured(board, make, first):
    parser = make()
    records = fed(parser, b"".join(stream(board)))
    agree(records, first)
    assert [record.missed for record in records] == [0] * (COUNT - first)
    assert parser.discarded == len(b"".join(stream(board)[:first]))


@BOTH
def test_bytes_may_come_one_by_one(board, make, first):
    data = b"".join(stream(board))
    assert bytewise(make(), data) == fed(make(), data)


@BOTH
def test_the_number_wraps_at_256(board, make, first):
    records = fed(make(), b"".join(stream(board, first=250)))
    assert [record.missed for record in records] == [0] * (COUNT - first)


@BOTH
def test_missing_samples_are_counted_by_the_number(board, make, first):
    data = stream(board, first=250)
    records = fed(make(), b"".join(data[:5] + data[12:]))
    assert sum(record.missed for record in records) == 7


@BOTH
def test_a_short_gap_before_the_wrap_is_counted_too(board, make, first):
    data = stream(board, first=240)
    records = fed(make(), b"".join(data[:5] + data[16:]))
    assert [record.missed for record in records if record.missed] == [11]


@BOTH
@pytest.mark.parametrize(("last", "begin"), [(0, 0), (5, 0), (200, 0), (100, 3), (3, 3)])
def test_a_module_that_starts_anew_has_missed_nothing(board, make, first, last, begin):
    data = stream(board, first=last + 1 - COUNT) + stream(board, first=begin)
    assert [record.missed for record in fed(make(), b"".join(data))] == [0] * (2 * COUNT - first)


@BOTH
def test_a_magnetometer_sent_again_is_none(board, make, first):
    (burst,) = sampled(board.settings, 1)
    data = b"".join(board.sample(burst, n, 0) for n in range(6))
    fresh = [record.reading.mag is not None for record in fed(make(), data)]
    assert fresh == [True] + [False] * (5 - first)


@BOTH
@given(data=st.lists(st.binary(max_size=600), max_size=6))
def test_whatever_comes_each_byte_is_used_waiting_or_counted(board, make, first, data):
    parser: Parser = make()
    for n, chunk in enumerate(data):
        if parser.feed(chunk):
            return
        waiting = sum(map(len, data[: n + 1])) - parser.discarded
        assert 0 <= waiting <= 256


@given(st.integers(0, SIZE * COUNT), st.binary(max_size=100))
def test_binary_finds_the_next_frame_after_any_garbage(position: int, garbage: bytes):
    data = b"".join(stream(RtUsbBinary()))
    parser = RtUsbBinaryParser()
    records = fed(parser, data[:position] + garbage + data[position:])
    assert COUNT - len(records) <= 2  # the one that was hit; the last, where garbage looks like it
    readings = fed(RtUsbBinaryParser(), data)
    whole = [(r.reading.gyro, r.reading.accel) for r in readings]
    torn = [r for r in records if (r.reading.gyro, r.reading.accel) not in whole]
    assert torn == []


@given(st.integers(0, SIZE * COUNT - 1), st.integers(1, 3 * SIZE))
def test_binary_never_joins_two_halves(position: int, lost: int):
    data = b"".join(stream(RtUsbBinary()))
    records = fed(RtUsbBinaryParser(), data[:position] + data[position + lost :])
    whole = [(r.reading.gyro, r.reading.accel) for r in fed(RtUsbBinaryParser(), data)]
    same = position % SIZE > 6 and lost % SIZE == 0  # from one frame into another at one place
    if not same:
        assert all((r.reading.gyro, r.reading.accel) in whole for r in records)


def test_binary_gives_a_sample_at_once_whatever_its_last_byte():
    """A weak field downwards ends every frame in 0xFF, as a header begins."""
    parser = RtUsbBinaryParser()
    for n in range(5):
        data = b"\xff\xffRT\x39\x41\x06" + bytes((n,)) + struct.pack("<10h", *[n] * 9, -n - 1)
        assert len(parser.feed(data)) == 1
    assert parser.discarded == 0


@pytest.mark.parametrize(
    ("firmware", "mag", "temperature"), [(6, 0.15e-6, 21.0), (5, 0.3e-6, 35.0)]
)
def test_the_scale_is_that_of_the_firmware(firmware: int, mag: float, temperature: float):
    data = (
        b"\xff\xffRT\x39\x41"
        + bytes((firmware, 0))
        + struct.pack("<10h", 2048, 0, -4096, 0, 164, 0, -164, 100, 200, -300)
    )
    (record,) = RtUsbBinaryParser().feed(data)
    assert record.reading.accel == pytest.approx((9.80665, 0.0, -2 * 9.80665))
    assert record.reading.gyro == pytest.approx((math.radians(10), 0.0, -math.radians(10)))
    assert record.reading.mag == pytest.approx((100 * mag, 200 * mag, -300 * mag))
    assert record.reading.temperature == temperature


def test_text_has_the_units_of_the_module():
    line = b"7,0.100000,-0.200000,0.300000,0.010000,0.020000,1.000000,10.0,-20.0,-40.0,25.5\r\n"
    (record,) = fed(RtUsbTextParser(), b"\n" + line)
    assert record.reading.gyro == pytest.approx((0.1, -0.2, 0.3))
    assert record.reading.accel == pytest.approx((0.0980665, 0.196133, 9.80665))
    assert record.reading.mag == pytest.approx((10e-6, -20e-6, -40e-6))
    assert record.reading.temperature == 25.5


@pytest.mark.parametrize(
    "line",
    [
        b"7,0.1,0.1,0.1,0.0,0.0,1.0,10.0,20.0,30.0",
        b"7,0.1,0.1,0.1,0.0,0.0,1.0,10.0,20.0,30.0,25.5,1.0",
        b"7.0,0.1,0.1,0.1,0.0,0.0,1.0,10.0,20.0,30.0,25.5",
        b"256,0.1,0.1,0.1,0.0,0.0,1.0,10.0,20.0,30.0,25.5",
        b"7,40.0,0.1,0.1,0.0,0.0,1.0,10.0,20.0,30.0,25.5",
        b"7,nan,0.1,0.1,0.0,0.0,1.0,10.0,20.0,30.0,25.5",
        b"[1] Start calibration",
    ],
)
def test_text_that_is_no_sample_is_discarded(line: bytes):
    parser = RtUsbTextParser()
    assert parser.feed(b"\n" + line + b"\n") == []
    assert parser.discarded == len(line) + 2


def test_another_module_of_the_maker_is_told_apart():
    parser = RtUsbBinaryParser()
    data = (b"\xff\xffRT\x40\x41\x01" + bytes(26)) * 4
    assert parser.feed(data) == []
    assert "without an MPU-9250" in parser.complaint


@pytest.mark.parametrize(
    ("name", "make"), [("rt_usb.txt", RtUsbTextParser), ("rt_usb.bin", RtUsbBinaryParser)]
)
def test_the_golden_stream_is_read_as_recorded(name: str, make):
    expected = json.loads((GOLDEN / f"{name.replace('.', '_')}.json").read_text())
    parser = make()
    records = parser.feed((GOLDEN / name).read_bytes())
    assert json.dumps(records) == json.dumps(expected["records"])
    assert parser.discarded == expected["discarded"]
