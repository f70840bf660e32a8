"""The Razor's text stream: every layout that its keys can switch on, replies, damage."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import pytest
from boards import Razor
from hypothesis import given
from hypothesis import strategies as st
from streams import COUNT, bytewise, differ, fed, meant, sampled, stream

from stateful_ahrs.mpu9250.protocols import Record
from stateful_ahrs.mpu9250.razor import RazorParser

GOLDEN = Path(__file__).parent / "golden"
FIRST = 2  # lines that are lost: the first may be cut, the next needs one that it goes on from
LAYOUTS = [
    Razor(time=time, calculated=calculated, quaternion=q, euler=e, heading=h)
    for time, calculated, q, e, h in product((True, False), repeat=5)
]
# half of the last decimal, in counts at ±2 g, ±2000 °/s and 0.15 µT; and the firmware's 6.665
DECIMALS = 0.005 * 16384 + 0.1
COUNTS = 3.0  # the firmware's 16.4 counts for 16.384, at up to 100 °/s; the field in whole counts


def layout(board: Razor) -> str:
    fields = stream(board)[0].count(b",") + 1
    return f"{fields}{' timed' * board.time}{' raw' * (not board.calculated)}"


def readings(records: list[Record], board: Razor, first: int = FIRST) -> bool:
    """Whether the records are those of the stream from ``first`` on, to its resolution."""
    expected = meant(board.settings)[first:]
    limit = DECIMALS if board.calculated else COUNTS
    return len(records) == len(expected) and all(
        differ(record.reading, reading) < limit
        for record, reading in zip(records, expected, strict=True)
    )


@pytest.mark.parametrize("board", LAYOUTS, ids=layout)
def test_every_layout_is_read(board: Razor):
    parser = RazorParser()
    records = fed(parser, b"".join(stream(board)))
    assert readings(records, board)
    assert parser.discarded == len(b"".join(stream(board)[:FIRST]))
    if board.time:
        assert [r.clock for r in records] == [
            2_000_000_000 + 10_000_000 * n for n in range(FIRST, COUNT)
        ]
    else:
        assert {r.clock for r in records} == {None}


@pytest.mark.parametrize("board", LAYOUTS, ids=layout)
def test_bytes_may_come_one_by_one(board: Razor):
    data = b"".join(stream(board))
    one, whole = bytewise(RazorParser(), data), fed(RazorParser(), data)
    assert [r._replace(reading=r.reading._replace(temperature=0.0)) for r in one] == [
        r._replace(reading=r.reading._replace(temperature=0.0)) for r in whole
    ]


def test_the_magnetometer_is_turned_into_the_frame_of_the_others():
    line = b"%d, 0.00, 0.00, 1.00, 0.00, 0.00, 0.00, 10.00, 20.00, 30.00\r\n"
    (record,) = fed(RazorParser(), b"\n" + line % 1000 + line % 1010)
    assert record.reading.mag == pytest.approx((20e-6, 10e-6, -30e-6))
    assert record.reading.accel == pytest.approx((0.0, 0.0, 9.80665))
    assert math.isnan(record.reading.temperature)


def test_raw_counts_have_the_scale_of_the_firmware():
    line = b"%d, 16384, 0, -8192, 164, 0, -1640, 667, 1333, -2000\r\n"
    (record,) = fed(RazorParser(), b"\n" + line % 1000 + line % 1010)
    assert record.reading.accel == pytest.approx((9.80665, 0.0, -4.903325))
    assert record.reading.gyro == pytest.approx((math.radians(10.0), 0.0, math.radians(-100.0)))
    assert record.reading.mag == pytest.approx((200e-6, 100e-6, 300e-6), rel=1e-3)


@pytest.mark.parametrize(
    "reply",
    [
        b"IMU rate set to 100 Hz\r\n",
        b"Accel FSR set to +/-4 g\r\n",
        b"Gyro FSR set to +/-250 dps\r\n",
        b"Error connecting to MPU-9250\r\n",
        b"\r\n",
    ],
)
def test_replies_between_the_lines_cost_nothing_but_themselves(reply: bytes):
    lines = stream(Razor())
    parser = RazorParser()
    records = fed(parser, b"".join(lines[:9]) + reply + b"".join(lines[9:]))
    assert readings(records, Razor())
    assert parser.discarded == len(b"".join(lines[:FIRST])) + len(reply)


def test_fields_switched_on_at_the_board_cost_one_line():
    before, after = stream(Razor())[:10], stream(replace(Razor(), heading=True))[10:]
    records = fed(RazorParser(), b"".join(before + after))
    assert len(records) == COUNT - FIRST - 1
    assert records[-1].missed == 0


def test_switching_to_raw_counts_costs_one_line_and_gives_the_same():
    before, after = stream(Razor())[:10], stream(replace(Razor(), calculated=False))[10:]
    records = fed(RazorParser(), b"".join(before + after))
    expected = meant(Razor.settings)
    expected = expected[FIRST:10] + expected[11:]
    assert len(records) == len(expected)
    assert all(differ(r.reading, e) < DECIMALS for r, e in zip(records, expected, strict=True))


@pytest.mark.parametrize(
    ("board", "keys"),
    [(Razor(accel=False), 7), (Razor(gyro=False, compass=False), 4), (Razor(compass=False), 7)],
)
def test_a_board_that_sends_too_little_is_told_apart(board: Razor, keys: int):
    parser = RazorParser()
    data = b"".join(stream(board))
    assert parser.feed(data) == []
    assert parser.discarded == len(data)
    assert f"lines have {keys} fields. Switch on the accelerometer" in parser.complaint


@given(st.integers(2, COUNT - 2), st.integers(1, 40), st.integers(0, 80))
def test_a_line_that_lost_bytes_gives_no_wrong_sample(line: int, count: int, position: int):
    """Lost digits before the point can pass for a measurement: in g, 0.98 from 10.98 cannot."""
    lines = stream(Razor())
    at = min(position, len(lines[line]) - 3)
    cut = lines[line][:at] + lines[line][at + count :]
    parser = RazorParser()
    records = fed(parser, b"".join(lines[:line]) + cut + b"".join(lines[line + 1 :]))
    clocks = [record.clock for record in records]
    assert clocks == sorted(clocks, key=lambda clock: clock or 0)
    assert len(records) >= COUNT - FIRST - 2
    assert sum(map(len, lines)) - len(lines[line]) + len(cut) - parser.discarded == sum(
        len(lines[(record.clock or 0) // 10_000_000 - 200]) if record.clock else 0
        for record in records
        if record.clock != 2_000_000_000 + 10_000_000 * line
    ) + (len(cut) if any(r.clock == 2_000_000_000 + 10_000_000 * line for r in records) else 0)


def test_a_time_that_does_not_fit_is_not_believed_until_it_goes_on():
    lines = stream(Razor())
    wrong = lines[10].replace(b"2100, ", b"210, ")
    parser = RazorParser()
    records = fed(parser, b"".join([*lines[:10], wrong, *lines[11:]]))
    assert len(records) == COUNT - FIRST - 1
    assert [record.missed for record in records] == [0] * len(records)


def test_a_board_that_restarts_costs_one_line():
    lines = stream(Razor())
    (burst,) = sampled(Razor.settings, 1)
    again = [Razor().sample(burst, n, 30_000 + 10_000 * n) for n in range(5)]
    records = fed(RazorParser(), b"".join(lines + again))
    assert len(records) == COUNT - FIRST + 4
    assert records[-1].clock == 70_000_000
    assert records[-1].missed == 0


def test_the_clock_wraps_after_49_days():
    (burst,) = sampled(Razor.settings, 1)
    start = ((1 << 32) - 50) * 1000
    lines = [Razor().sample(burst, n, start + 10_000 * n) for n in range(10)]
    records = fed(RazorParser(), b"".join(lines))
    clocks = [record.clock or 0 for record in records]
    assert [b - a for a, b in pairwise(clocks)] == [10_000_000] * 7


def test_missing_lines_are_counted_by_the_time():
    lines = stream(Razor())
    records = fed(RazorParser(), b"".join(lines[:20] + lines[23:]))
    assert sum(record.missed for record in records) == 3


def test_a_measurement_sent_again_is_none():
    lines = stream(Razor())
    same = b", ".join(lines[9].strip().split(b", ")[7:])
    tenth = b", ".join([*lines[10].split(b", ")[:7], same]) + b"\r\n"
    records = fed(RazorParser(), b"".join([*lines[:10], tenth, *lines[11:]]))
    fresh = [record.reading.mag is not None for record in records]
    assert fresh == [True] * 8 + [False] + [True] * 13


@pytest.mark.parametrize(
    ("values", "saturated"),
    [
        (b"2.00, 0.00, -2.00, 0.00, 0.00, 0.00", ("accel x", "accel z")),
        (b"0.00, 0.00, 1.00, 1997.99, -1998.05, 0.00", ("gyro x", "gyro y")),
        (b"32767, 0, 16384, 0, 0, -32768", ("accel x", "gyro z")),
        (b"1.99, 0.00, 1.00, 0.00, 1990.00, 0.00", ()),
    ],
)
def test_saturated_axes_are_named(values: bytes, saturated: tuple[str, ...]):
    mag = b"1, 2, 3" if b"." not in values else b"1.00, 2.00, 3.00"
    line = b"%d, " + values + b", " + mag + b"\r\n"
    (record,) = fed(RazorParser(), b"\n" + line % 1000 + line % 1010)
    assert record.reading.saturated == saturated


def test_a_field_too_strong_is_an_overflow():
    line = b"%d, 0.00, 0.00, 1.00, 0.00, 0.00, 0.00, 4000.00, 900.00, 300.00\r\n"
    (record,) = fed(RazorParser(), b"\n" + line % 1000 + line % 1010)
    assert record.reading.mag is None
    assert record.reading.mag_overflow


@given(st.lists(st.binary(max_size=600), max_size=8))
def test_whatever_comes_each_byte_is_waiting_or_counted(chunks: list[bytes]):
    parser = RazorParser()
    for n, chunk in enumerate(chunks):
        if parser.feed(chunk):
            return
        waiting = sum(map(len, chunks[: n + 1])) - parser.discarded
        assert 0 <= waiting <= 256


@given(
    st.lists(
        st.lists(
            st.sampled_from([b"", b"1", b"-1.25", b"0.01", b"99999", b"nan", b"1e9", b"4294967295"])
            | st.binary(max_size=5),
            max_size=20,
        ).map(b", ".join),
        max_size=10,
    ).map(b"\r\n".join)
)
def test_lines_that_look_alike_raise_nothing(data: bytes):
    for record in RazorParser().feed(data):
        assert all(map(math.isfinite, record.reading.gyro + record.reading.accel))


def test_the_golden_stream_is_read_as_recorded():
    expected = json.loads((GOLDEN / "razor.json").read_text())
    parser = RazorParser()
    records = parser.feed((GOLDEN / "razor.txt").read_bytes())
    assert json.dumps(records) == json.dumps(expected["records"])
    assert parser.discarded == expected["discarded"]
