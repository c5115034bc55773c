# SPDX-License-Identifier: Apache-2.0
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

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


@given(st.binary(max_size=60))
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
    inner = encode('/a', 1)
    bundle = b'#bundle\0' + bytes(8) + len(inner).to_bytes(4, 'big') + inner
    out._socket.sendto(bundle, out._address)
    out._socket.sendto(b'nonsense', out._address)
    deadline, found = time.monotonic() + 2, []
    while time.monotonic() < deadline and (len(found) < 2 or not source.bad):
        found += source.take()
    assert found == [('/eol/set/gain_db', -12.0), ('/a', 1)]
    assert source.bad == 1
    with pytest.raises(DeviceMissing, match='cannot be had'):
        OscIn(source.port)
    for wrong in ('here', 'localhost:', 'localhost:99999', ':57120'):
        with pytest.raises(ConfigError, match='host:port'):
            OscOut(wrong)
    source.close()
    out.close()
