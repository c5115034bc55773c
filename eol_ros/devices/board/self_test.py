# SPDX-License-Identifier: Apache-2.0
"""What a block's test of itself tells: the circuit is docs/build/block.yaml."""

from eol_ros.core.serial_protocol import ANSWERS, SelfTested

PULL_MG = (68, 1440)  # LIS3DH, DocID17530, table 4: 17 to 360 digits of 4 mg
LED_MV = 400  # that a cell at 3.0 V leaves behind a dark white LED, at least
LIT_MV = 300  # behind a lit one, at most: what its transistor keeps
INFRARED_MV = (900, 1800)  # over an infrared LED that is lit


def faults(test: SelfTested) -> list[str]:
    """Return what is wrong with a block that has tested itself; a sentence each."""
    found = []
    if not test.flags & ANSWERS:
        found.append('its accelerometer does not answer: look at SDA, SCL and its supply')
    else:
        for axis in 'xyz':
            pull = abs(getattr(test, f'{axis}_mg'))
            if not PULL_MG[0] <= pull <= PULL_MG[1]:
                found.append(
                    f'its accelerometer moves by {pull} mg along {axis}, '
                    f'{PULL_MG[0]} to {PULL_MG[1]} is right: exchange it'
                )
    if test.white_off_mv < LED_MV:
        found.append('its white LED does not conduct: look at D2, R2 and for a short at Q1')
    elif test.white_on_mv > LIT_MV:
        found.append('its white LED is not switched on: look at Q1 and R3')
    if test.infrared_mv > INFRARED_MV[1]:
        found.append('its infrared LED does not conduct: look at D1')
    elif test.infrared_mv < INFRARED_MV[0]:
        found.append('its infrared LED gets no current: look at R1 and for a short at D1')
    return found
