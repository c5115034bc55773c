# SPDX-License-Identifier: Apache-2.0
import random
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eol_ros.core import serial_protocol as p

RANGES = {'B': (0, 255), 'b': (-128, 127), 'H': (0, 65535), 'h': (-(2**15), 2**15 - 1),
          'I': (0, 2**32 - 1)}  # fmt: skip


def fields(form):
    """Yield a strategy for each field of a struct format."""
    for count, code in re.findall(r'(\d*)([a-zA-Z])', form):
        if code == 's':
            yield st.binary(min_size=int(count), max_size=int(count))
        else:
            yield from [st.integers(*RANGES[code])] * int(count or 1)


MESSAGES = st.one_of(st.builds(m, *fields(m.BODY.format)) for m in p.MESSAGES.values())


def pieces(data, seed):
    """Cut `data` anywhere, as a serial port does."""
    cut, rng = 0, random.Random(seed)
    while cut < len(data):
        step = rng.randint(1, 9)
        yield data[cut : cut + step]
        cut += step


def read(data, seed=0):
    decoder = p.Decoder()
    found = [r.message for piece in pieces(data, seed) for r in decoder.feed(piece)]
    return found, decoder


def test_checksum_is_the_one_named():
    assert p.crc16(b'123456789') == 0x29B1


@pytest.mark.parametrize(
    ('plain', 'stuffed'),
    [  # examples of the paper's kind
        (b'', b'\x01'),
        (b'\x00', b'\x01\x01'),
        (b'\x11\x22\x00\x33', b'\x03\x11\x22\x02\x33'),
        (b'\x11\x00\x00\x00', b'\x02\x11\x01\x01\x01'),
        (bytes(range(1, 254)), b'\xfe' + bytes(range(1, 254))),
    ],
)
def test_cobs_examples(plain, stuffed):
    assert p.cobs_encode(plain) == stuffed
    assert p.cobs_decode(stuffed) == plain


@given(st.binary(max_size=1200))
def test_cobs_gives_back_what_it_took(data):
    stuffed = p.cobs_encode(data)

    assert 0 not in stuffed
    assert p.cobs_decode(stuffed) == data
    assert len(stuffed) <= len(data) + 1 + len(data) // 254


@given(st.lists(MESSAGES, max_size=12), st.integers(0, 2**16))
def test_messages_survive_the_wire_in_any_pieces(messages, seed):
    wire = b''.join(p.encode(m, k) for k, m in enumerate(messages))
    found, decoder = read(wire, seed)

    assert found == messages
    assert (decoder.good, decoder.bad) == (len(messages), 0)


@given(MESSAGES, st.integers(0, 10**6))
def test_no_single_damaged_byte_passes(message, where):
    wire = bytearray(p.encode(message, 9))
    at = 1 + where % (len(wire) - 2)
    wire[at] ^= 1 + where % 255
    found, decoder = read(bytes(wire) + p.encode(p.Ping(1), 10))

    assert [m for m in found if m != p.Ping(1)] == []
    assert p.Ping(1) in found
    assert decoder.bad >= 1


@settings(max_examples=50)
@given(st.binary(max_size=400), st.lists(MESSAGES, min_size=1, max_size=4))
def test_noise_before_frames_costs_no_frame(noise, messages):
    wire = noise + b''.join(p.encode(m, k) for k, m in enumerate(messages))
    found, _ = read(wire)

    assert found[-len(messages) :] == messages


@given(MESSAGES, MESSAGES, st.integers(1, 30))
def test_a_truncated_frame_costs_only_itself(first, second, keep):
    whole = p.encode(first, 0)
    found, decoder = read(whole[: min(keep, len(whole) - 2)] + p.encode(second, 1))

    assert found == [second]
    assert decoder.good == 1


def test_an_oversized_frame_takes_no_memory_and_costs_only_itself():
    found, decoder = read(b'\x05' * 100_000 + p.encode(p.Ping(3), 0))

    assert found == [p.Ping(3)]
    assert decoder.bad == 1
    assert len(decoder._pending) <= p.MAX_ENCODED + 1


def test_a_kind_of_tomorrow_is_counted_and_left():
    packet = bytes([0x42, 0]) + b'later'
    packet += p.crc16(packet).to_bytes(2, 'little')
    found, decoder = read(b'\0' + p.cobs_encode(packet) + b'\0' + p.encode(p.Ping(1), 1))

    assert found == [p.Ping(1)]
    assert decoder.bad == 1


def test_a_body_of_another_length_is_damage():
    packet = bytes([p.Knock.KIND, 0]) + b'123'
    packet += p.crc16(packet).to_bytes(2, 'little')
    found, decoder = read(b'\0' + p.cobs_encode(packet) + b'\0')

    assert (found, decoder.bad) == ([], 1)


def test_values_that_do_not_fit_are_named():
    with pytest.raises(p.ProtocolError, match='SelfTest'):
        p.encode(p.SelfTest(256), 0)


@pytest.mark.parametrize('mask', [0, 2**25 - 1, 2**32 - 1, 2**32, p.ALL_BLOCKS])
@pytest.mark.parametrize('make', [p.Infrared, lambda mask: p.Light(7, mask)])
def test_masks_take_four_bytes_and_more_only_for_more_blocks(make, mask):
    message = make(mask)
    wire = p.encode(message, 3)
    body = p.cobs_decode(wire[1:-1])[2:-2]

    assert read(wire)[0] == [message]
    assert len(body) == message.BODY.size + max(0, -(-(mask.bit_length() - 32) // 8))
    assert len(body) <= p.MAX_BODY
