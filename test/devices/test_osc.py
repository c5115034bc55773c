# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.waiting import wait_until

from eol_ros.devices.audio.osc import OscIn, OscOut, decode, encode
from eol_ros.errors import ConfigError, DeviceMissing

VALUES = st.lists(
    st.one_of(
        st.integers(-(2**31), 2**31 - 1),
        st.floats(width=32, allow_nan=False),
        st.booleans(),
        st.text(st.characters(blacklist_characters='\0', blacklist_categories=['Cs'])),
    )
)


@given(VALUES)
def test_what_goes_in_comes_out(values):
    assert decode(encode('/eol/x', *values)) == [('/eol/x', *values)]
    assert len(encode('/eol/x', *values)) % 4 == 0


def test_the_examples_of_the_specification():
    """OSC 1.0, section "OSC Message Examples"."""
    assert encode('/oscillator/4/frequency', 440.0) == (
        b'/oscillator/4/frequency\0,f\0\0\x43\xdc\0\0'
    )
    assert encode('/foo', 1000, -1, 'hello', 1.234, 5.678) == bytes.fromhex(
        '2f666f6f000000002c6969736666000000000 3e8ffffffff68656c6c6f0000003f9df3b640b5b22d'.replace(
            ' ', ''
        )
    )


def bundle(*parts):
    return b'#bundle\0' + bytes(8) + b''.join(len(p).to_bytes(4, 'big') + p for p in parts)


def test_a_bundle_whose_sizes_do_not_add_up_is_refused():
    """A part of -4 bytes had python-osc read the same size for ever: one datagram, no sound."""
    head, message = b'#bundle\0' + bytes(8), encode('/eol/x', 1)
    for size in (-4, -1, -(2**31), len(message) + 1, 2**31 - 1):
        with pytest.raises(ValueError, match=f'part of {size} bytes'):
            decode(head + size.to_bytes(4, 'big', signed=True) + message)
    with pytest.raises(ValueError, match='part of 0 bytes'):
        decode(bundle(message) + b'\0\0')  # a size that is cut off
    nested = message
    for _ in range(16):
        nested = bundle(nested)
    assert decode(nested) == [('/eol/x', 1)]
    for _ in range(3000):
        nested = bundle(nested)
    with pytest.raises(ValueError, match='more than 16'):
        decode(nested)


@st.composite
def packets(draw):
    """Draw noise, and messages and bundles of which some bytes are others, or missing."""
    parts = [encode('/eol/x', *draw(VALUES)) for _ in range(draw(st.integers(1, 3)))]
    nested = [parts[0], bundle(*parts), bundle(bundle(*parts), *parts)]
    packet = bytearray(draw(st.sampled_from([draw(st.binary(max_size=60)), *nested])))
    for _ in range(draw(st.integers(0, 4)) if packet else 0):
        packet[draw(st.integers(0, len(packet) - 1))] = draw(st.integers(0, 255))
    return bytes(packet[: draw(st.integers(0, len(packet)))])


@given(packets())
def test_no_packet_harms(packet):
    try:
        found = decode(packet)
    except ValueError:
        return
    assert all(isinstance(address, str) for address, *_ in found)


def test_over_the_wire():
    source = OscIn(0)
    out = OscOut(f'127.0.0.1:{source.port}')
    out.send('/eol/set/gain_db', -12.0)
    out._socket.sendto(bundle(encode('/a', 1)), out._address)
    out._socket.sendto(b'nonsense', out._address)
    found = []
    wait_until(lambda: found.extend(source.take()) or (len(found) == 2 and source.bad))
    assert found == [('/eol/set/gain_db', -12.0), ('/a', 1)]
    assert source.bad == 1
    with pytest.raises(DeviceMissing, match='cannot be had'):
        OscIn(source.port)
    for wrong in ('here', 'localhost:', 'localhost:99999', ':57120'):
        with pytest.raises(ConfigError, match='host:port'):
            OscOut(wrong)
    source.close()
    out.close()
