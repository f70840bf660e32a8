"""The protocol is found from the first samples, and never from what is none."""

from __future__ import annotations

import pytest
from boards import BOARDS, Bridge
from hypothesis import given
from hypothesis import strategies as st
from streams import COUNT, bytewise, fed, stream

from stateful_ahrs.errors import UsageError
from stateful_ahrs.mpu9250.detect import parser

BY_NAME = {"razor": "razor", "rt_usb text": "rt_usb", "rt_usb binary": "rt_usb", "frame": "frame"}
LOST = {"razor": 2, "rt_usb text": 1, "rt_usb binary": 0, "frame": 0}


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("junk", [b"", b"\x00\x00", b"ets Jun  8 2016 00:22:57\r\nboot\r\n"])
def test_auto_finds_every_protocol_and_loses_no_sample_by_it(name: str, junk: bytes):
    auto, alone = parser("auto"), parser(BY_NAME[name])
    data = junk + b"".join(stream(BOARDS[name]()))
    records = fed(auto, data)
    assert auto.name == alone.name or auto.name == name
    assert len(records) == len(fed(alone, data)) >= COUNT - LOST[name] - 1
    assert auto.name == alone.name == name
    assert auto.discarded == alone.discarded


@pytest.mark.parametrize("name", BOARDS)
def test_bytes_may_come_one_by_one(name: str):
    assert len(bytewise(parser("auto"), b"".join(stream(BOARDS[name]())))) >= COUNT - LOST[name]


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("protocol", ["razor", "rt_usb", "frame"])
def test_another_protocol_by_name_gives_nothing(name: str, protocol: str):
    if BY_NAME[name] != protocol:
        assert fed(parser(protocol), b"".join(stream(BOARDS[name]()))) == []


@given(st.lists(st.binary(max_size=600), max_size=10))
def test_noise_is_no_protocol(chunks: list[bytes]):
    auto = parser("auto")
    assert [record for chunk in chunks for record in auto.feed(chunk)] == []
    assert auto.name == ""
    assert auto.discarded <= sum(map(len, chunks))


def test_an_unknown_protocol_is_refused_with_those_there_are():
    with pytest.raises(UsageError, match="one of auto, frame, razor, rt_usb, got 'nmea'"):
        parser("nmea")


@pytest.mark.parametrize("junk", [b"", b"\n7\r\n"])  # digits alone in a line, as chance has them
def test_auto_names_the_chip_of_a_bridge_that_has_another(junk: bytes):
    auto = parser("auto")
    assert fed(auto, junk + b"".join(stream(Bridge(who_am_i=0x75)))) == []
    assert "answers 0x75" in auto.complaint


def test_what_the_only_parser_that_understands_it_says_is_passed_on():
    auto = parser("auto")
    auto.feed(b"\n" + b"1234, 0.01, 0.02, 0.99, 1.00, 2.00, 3.00\r\n" * 3)
    assert "lines have 7 fields" in auto.complaint
