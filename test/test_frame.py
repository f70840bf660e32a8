"""Our own frame: framing, checksum, numbering; whatever is on the line, no exception."""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path

import pytest
from boards import FUSES, Bridge
from hypothesis import given
from hypothesis import strategies as st
from streams import COUNT, bytewise, fed, meant, sampled, stream

from stateful_ahrs.mpu9250 import frame
from stateful_ahrs.mpu9250.frame import FrameParser

SIZE = 39  # bytes of a frame on the line
GOLDEN = Path(__file__).parent / "golden"


@given(st.binary(max_size=253))
def test_stuffing_leaves_no_zero_and_loses_nothing(data: bytes):
    stuffed = frame.stuff(data)
    assert 0 not in stuffed
    assert len(stuffed) == len(data) + 1
    assert frame.unstuff(stuffed) == data


@pytest.mark.parametrize("data", [b"\x05\x01\x02", b"\x00", b"\x02"])
def test_what_was_never_stuffed_is_none(data: bytes):
    assert frame.unstuff(data) is None


def test_the_checksum_is_that_of_the_catalogue():
    """CRC-16/CCITT-FALSE of the catalogue's check string."""
    assert frame.crc(b"123456789") == 0x29B1


def test_a_frame_has_39_bytes_so_that_1_khz_fits_921600_baud():
    data = stream(Bridge())[0]
    assert len(data) == SIZE
    assert data.count(0) == 1
    assert data.endswith(b"\0")
    assert 1000 * SIZE * 10 < 0.5 * 921600  # 10 bits a byte, and half the line to spare


def test_records_are_what_the_same_bytes_mean_on_a_bus():
    records = fed(FrameParser(), b"".join(stream(Bridge())))
    assert [record.reading for record in records] == meant(Bridge.settings)
    assert [record.missed for record in records] == [0] * COUNT
    assert [record.clock for record in records] == [
        2_000_000_000 + 10_000_000 * n for n in range(COUNT)
    ]


def test_bytes_may_come_one_by_one():
    data = b"".join(stream(Bridge()))
    assert bytewise(FrameParser(), data) == fed(FrameParser(), data)


@given(st.lists(st.integers(1, 80)))
def test_bytes_may_come_in_any_pieces(pieces: list[int]):
    data = b"".join(stream(Bridge()))
    parser = FrameParser()
    assert fed(parser, data, pieces) == fed(FrameParser(), data)
    assert parser.discarded == 0


def test_the_number_and_the_clock_wrap():
    (burst,) = sampled(Bridge.settings, 1)
    frames = [
        frame.pack(0x71, 1000, 4, bytes(FUSES), 0xFFFE + n, 0xFFFFFC18 + 1000 * n, burst)
        for n in range(4)
    ]
    records = fed(FrameParser(), b"".join(frames))
    assert [record.missed for record in records] == [0] * 4
    first = 0xFFFFFC18 * 1000
    assert [record.clock for record in records] == [first + 1_000_000 * n for n in range(4)]


@pytest.mark.parametrize("lost", [1, 2, 17])
def test_frames_lost_on_the_way_are_counted_by_their_number(lost: int):
    frames = stream(Bridge())
    records = fed(FrameParser(), b"".join(frames[:3] + frames[3 + lost :]))
    assert [record.missed for record in records] == [0, 0, 0, lost] + [0] * (COUNT - lost - 4)


@pytest.mark.parametrize("micros", [0, 1_900_000])
def test_a_bridge_that_restarts_has_lost_nothing(micros: int):
    """Its number and its clock begin again; how long it was away, they do not tell."""
    (burst,) = sampled(Bridge.settings, 1)
    again = frame.pack(0x71, 1000, 4, bytes(FUSES), 0, micros, burst)
    *_, last = fed(FrameParser(), b"".join(stream(Bridge(), first=500)) + again)
    assert last.missed == 0
    assert last.clock == micros * 1000


@given(st.integers(0, COUNT * SIZE - 1), st.integers(1, 255))
def test_a_byte_that_was_changed_costs_its_frame_and_no_other(position: int, change: int):
    data = bytearray(b"".join(stream(Bridge())))
    data[position] ^= change
    parser = FrameParser()
    records = fed(parser, bytes(data))
    hit = position // SIZE
    ends = position % SIZE == SIZE - 1  # the zero is gone: two frames have become one
    kept = meant(Bridge.settings)
    del kept[hit : hit + 1 + ends]
    assert [record.reading for record in records] == kept
    unfinished = SIZE if ends and hit == COUNT - 1 else 0
    assert parser.discarded in (SIZE * (1 + ends) - unfinished, SIZE * (1 + ends))


@given(st.integers(0, COUNT * SIZE), st.binary(max_size=200))
def test_after_any_garbage_the_next_frame_is_found(position: int, garbage: bytes):
    data = b"".join(stream(Bridge()))
    parser = FrameParser()
    records = fed(parser, data[:position] + garbage + b"\0" + data[position:])
    kept = {id(r): r for r in meant(Bridge.settings)}
    assert COUNT - len(records) <= 1
    assert all(record.reading in kept.values() for record in records)
    total = COUNT * SIZE + len(garbage) + 1
    assert parser.discarded == total - SIZE * len(records)


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_whatever_comes_each_byte_is_used_waiting_or_counted(chunks: list[bytes]):
    parser = FrameParser()
    for n, chunk in enumerate(chunks):
        assert parser.feed(chunk) == []
        waiting = sum(map(len, chunks[: n + 1])) - parser.discarded
        assert 0 <= waiting <= SIZE


def test_a_line_that_never_ends_does_not_fill_the_memory():
    parser = FrameParser()
    for _ in range(1000):
        parser.feed(b"\x55" * 1000)
    assert parser.discarded >= 1_000_000 - SIZE
    assert len(fed(parser, b"\0" + b"".join(stream(Bridge())))) == COUNT


def forged(**changed: int) -> bytes:
    """A frame whose bytes at these places are others, its checksum right."""
    body = bytearray(frame.BODY.size)
    (burst,) = sampled(Bridge.settings, 1)
    frame.BODY.pack_into(body, 0, 1, 0x71, 0x06, bytes(FUSES), 7, 7, burst)
    for place, value in changed.items():
        body[int(place[1:])] = value
    return frame.stuff(bytes(body) + struct.pack("<H", frame.crc(bytes(body)))) + b"\0"


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (forged(_0=2), "version 2 and 37 bytes, expected 1 and 37: load the sketch"),
        (forged(_1=0x68), "answers 0x68 (MPU-6050 or MPU-9150) to WHO_AM_I"),
        (forged(_1=0xFF), "of the chip behind it every byte reads as 0xFF"),
        (forged(_1=0x12), "answers 0x12 (ICM-20602) to WHO_AM_I"),
        (forged(_12=0), "no new samples"),
        (forged(**{f"_{n}": 0xFF for n in range(12, 35)}), "every byte reads as 0xFF"),
    ],
)
def test_a_whole_frame_that_is_of_no_use_is_discarded_with_the_reason(data: bytes, complaint: str):
    parser = FrameParser()
    assert parser.feed(data) == []
    assert complaint in parser.complaint
    assert parser.discarded == len(data)


@pytest.mark.parametrize(("who", "fuses"), [(0x70, FUSES), (0x71, (255,) * 3), (0x71, (0,) * 3)])
def test_without_a_magnetometer_there_are_six_axes(who: int, fuses: tuple[int, int, int]):
    (burst,) = sampled(Bridge.settings, 1)
    (record,) = FrameParser().feed(frame.pack(who, 1000, 4, bytes(fuses), 0, 0, burst[:15]))
    assert record.reading == meant(Bridge.settings)[0]._replace(mag=None)


@pytest.mark.parametrize(("gyro", "accel"), [(250, 2), (500, 4), (1000, 8), (2000, 16)])
def test_the_ranges_travel_with_each_frame(gyro: int, accel: int):
    (burst,) = sampled(Bridge.settings, 1)
    (record,) = FrameParser().feed(frame.pack(0x73, gyro, accel, bytes(FUSES), 0, 0, burst))
    reading = meant(Bridge.settings)[0]
    assert record.reading.gyro == pytest.approx([n * gyro / 1000 for n in reading.gyro])
    assert record.reading.accel == pytest.approx([n * accel / 4 for n in reading.accel])


def test_the_example_of_the_document_is_a_frame():
    document = (Path(__file__).parents[1] / "docs" / "frame.md").read_text()
    (example,) = re.findall("```([0-9a-f\\s]+)```", document)
    (record,) = FrameParser().feed(bytes.fromhex(example))
    assert record.reading == meant(Bridge.settings)[3]
    assert record.clock == 2_030_000_000


def test_the_golden_stream_is_read_as_recorded():
    expected = json.loads((GOLDEN / "frame.json").read_text())
    parser = FrameParser()
    records = parser.feed((GOLDEN / "frame.bin").read_bytes())
    assert json.dumps(records) == json.dumps(expected["records"])
    assert parser.discarded == expected["discarded"]
