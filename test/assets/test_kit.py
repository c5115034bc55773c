# SPDX-License-Identifier: Apache-2.0
"""What a workshop builds from is what the firmware runs on: docs/build against firmware/."""

import re

import numpy as np
import pytest
import yaml
from support.checkout import ROOT

from assets.kit import netlist
from assets.kit.netlist import NetlistError
from eol_ros.core.table import Table

BLOCK = ROOT / 'firmware' / 'block'
# What the ATmega328P has at fixed pins (data sheet 8271, 14.3); firmware/block/pins.h says so, too.
FIXED = {'SCK': 'PB5', 'MISO': 'PB4', 'MOSI': 'PB3', 'SDA': 'PC4', 'SCL': 'PC5'}


@pytest.fixture(scope='module')
def circuit():
    return netlist.load()


def firmware_pins():
    """Return the pins of pins.h by their names, like PB1; a comment says from where which port."""
    text = (BLOCK / 'pins.h').read_text().split('enum {')[1].split('};')[0]
    found, port = {}, ''
    for line in text.splitlines():
        said = re.search(r'/\* port ([BCD])', line)
        port = said[1] if said else port
        for name, number in re.findall(r'(\w+) = (\d)', line):
            found[name] = f'P{port}{number}'
    return found


def test_the_pins_are_those_of_the_firmware(circuit):
    pins = firmware_pins()
    assert {'RADIO_CE', 'BATTERY', 'SENSOR_INT', 'INFRARED', 'WHITE'} <= pins.keys()
    for name, pin in {**pins, **FIXED}.items():
        assert ('U1', pin) in circuit.nets[name], f'{name}: the firmware has it at {pin}'
    named = {pin for name in circuit.nets for ref, pin in circuit.nets[name] if ref == 'U1'}
    ports = {pin for pin in named if re.fullmatch('P[BCD][0-7]', pin)}
    assert ports == {*pins.values(), *FIXED.values()}


def test_the_radio_gets_the_lines_that_it_is_driven_by(circuit):
    joined = {'CE': 'RADIO_CE', 'CSN': 'RADIO_CSN', 'IRQ': 'RADIO_IRQ', 'SCK': 'SCK',
              'MOSI': 'MOSI', 'MISO': 'MISO', 'VCC': '+3V3', 'GND': 'GND'}  # fmt: skip
    assert {pin: circuit.net('U3', pin) for pin in circuit.parts['U3'].pins} == joined
    # IRQ is open-drain only by name: the firmware pulls it up for the case that no radio is there
    assert 'PORTD = (1 << INFRARED) | (1 << RADIO_IRQ)' in (BLOCK / 'main.c').read_text()


def test_the_accelerometer_has_the_address_that_is_asked(circuit):
    address = int(re.search(r'ADDRESS = (0x\w+)', (BLOCK / 'lis3dh.c').read_text())[1], 16)
    high = circuit.net('U2', 'SDO') == '+3V3'
    assert circuit.net('U2', 'SDO') in ('+3V3', 'GND')
    assert address == 0x18 + high
    assert circuit.net('U2', 'CS') == '+3V3'  # I2C
    assert {'R6', 'R7'} == {
        r for net in ('SDA', 'SCL') for r, _ in circuit.nets[net] if r[0] == 'R'
    }


def ohms(circuit, ref):
    number, unit = circuit.parts[ref].name.split()
    return float(number) * {'Ohm': 1, 'kOhm': 1e3, 'MOhm': 1e6}[unit]


def test_the_battery_is_read_by_the_divider_that_is_there(circuit):
    reads = re.search(r'millivolts = .*ADC \* (\d+) / 1024\)', (BLOCK / 'main.c').read_text())
    divider = (ohms(circuit, 'R4') + ohms(circuit, 'R5')) / ohms(circuit, 'R5')
    assert int(reads[1]) == pytest.approx(1100 * divider, rel=1e-3)  # mV; 1.1 V is its reference
    for above, below, name in (('R10', 'R11', 'WHITE_SENSE'), ('R12', 'R13', 'INFRARED_SENSE')):
        share = 1 + ohms(circuit, above) / ohms(circuit, below)
        assert share == pytest.approx(divider, rel=0.02)  # as main.c has it: four times
        assert circuit.net(above, '2') == circuit.net(below, '1') == name
    assert 'ADC * 4400 / 1024' in (BLOCK / 'main.c').read_text().split('four_times(')[1]
    assert circuit.net('R10', '1') == circuit.net('Q1', 'C')
    assert circuit.net('R12', '1') == circuit.net('D1', 'A')
    ends = {circuit.net('R4', '1'), circuit.net('R4', '2'), circuit.net('R5', '2')}
    assert ends == {'BATT', 'BATTERY', 'GND'}
    assert circuit.nets['AREF'] == [('U1', 'AREF'), ('C3', '1')]  # never driven: it is 1.1 V


def test_the_fuses_are_those_of_the_clock_that_the_firmware_counts_with(circuit):
    """Data sheet 8271, tables 9-4 and 28-7: a programmed fuse is 0."""
    makefile = (ROOT / 'firmware' / 'Makefile').read_text()
    assert '-DF_CPU=8000000UL' in makefile
    assert all(f'-U {n}:w:0x{f["value"]:02X}:m' in makefile for n, f in circuit.fuses.items())
    assert '8 MHz' in circuit.parts['Y1'].what
    low, high, extended = (circuit.fuses[f]['value'] for f in ('lfuse', 'hfuse', 'efuse'))
    assert low & 0x80 and low & 0x0F == 0x0F and low & 0x30 == 0  # not divided; 8 to 16 MHz; 1K CK
    assert not high & 0x08  # EESAVE: an erased chip keeps its number
    assert high & 0x80 and not high & 0x20  # RESET is a reset; SPI programming stays possible
    assert extended & 7 == 0b101  # brown-out at 2.7 V: 8 MHz is safe from 2.4 V on


@pytest.fixture(scope='module')
def bridge():
    return netlist.load(netlist.BRIDGE)


def test_the_bridge_is_wired_as_its_firmware_has_it(bridge):
    text = (ROOT / 'firmware' / 'bridge' / 'pins.h').read_text().split('enum {')[1].split('};')[0]
    port, found = '', {}
    for line in text.splitlines():
        said = re.search(r'/\* port ([ABC])', line)
        port = said[1] if said else port
        for name, number in re.findall(r'(\w+) = (\d+)', line):
            found[name] = f'{port}{number}'
    assert found.pop('LIT') == 'C13'  # the board's own LED
    assert found == {name: pin for name, pins in bridge.nets.items() for ref, pin in pins
                     if ref == 'U1' and re.fullmatch(r'[ABC]\d+', pin)}  # fmt: skip
    # SPI 1 and USART 1 of the part (DS5319, table 5); its loader listens there, too
    fixed = {'SCK': 'A5', 'MISO': 'A6', 'MOSI': 'A7', 'TO_HOST': 'A9', 'FROM_HOST': 'A10'}
    assert fixed.items() <= found.items()
    assert '8 MHz' in bridge.parts['U1'].what  # which bluepill.c makes nine times as much of
    source = (ROOT / 'firmware' / 'bridge' / 'bluepill.c').read_text()
    assert 'PLL_9_TIMES_HSE' in source and 'CLOCK_HZ = 72000000' in source


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        (lambda raw: raw['nets']['SDA'].append('U1.PC5'), r'U1.PC5 is in SDA and in SCL'),
        (lambda raw: raw['nets']['SDA'].remove('U2.SDA'), r'U2.SDA is in no net'),
        (lambda raw: raw['nets']['SDA'].append('U9.SDA'), r'no pin U9.SDA'),
    ],
)
def test_a_circuit_that_cannot_be_is_refused(tmp_path, change, says):
    raw = yaml.safe_load(netlist.FILE.read_text())
    change(raw)
    file = tmp_path / 'block.yaml'
    file.write_text(yaml.safe_dump(raw, sort_keys=False))
    with pytest.raises(NetlistError, match=says):
        netlist.load(file)


def test_what_is_made_is_up_to_date():
    pytest.importorskip('schemdraw')
    from assets.kit.__main__ import FOLDER, made, same

    for name, text in made().items():
        assert same(name, (FOLDER / name).read_text(), text), f'{name}: make kit'


@pytest.mark.parametrize(
    ('name', 'numbers'),
    [
        # blocks, springs, between blocks, to the rim, pins, tubes along x and y, platform
        ('rehearsal', (25, 60, 40, 20, 100, '1014 mm', '1014 mm', '1400 x 1400 mm')),
        ('small', (9, 24, 12, 12, 36, '474 mm', '474 mm', '700 x 700 mm')),
        ('ring', (16, 36, 16, 20, 52, '1014 mm', '1014 mm', '1400 x 1400 mm')),
        ('wide', None),
    ],
)
def test_the_kit_of_a_scene_is_that_of_its_table(tmp_path, capsys, name, numbers):
    ezdxf = pytest.importorskip('ezdxf')
    from assets.kit.__main__ import main
    from eol_ros import scene

    assert main(['--scene', name, '--output', str(tmp_path)]) == 0
    parts = (tmp_path / 'parts.md').read_text()
    rows = [row.split(' | ') for row in parts.splitlines() if row.startswith('| ')]
    told = {row[0].lstrip('| '): row[1:] for row in rows}
    table = Table.of(scene.load(name).table)
    circuits = told['D1'][3]
    assert circuits == told['BT1'][3] == str(table.count)
    if numbers:
        count, springs, between, to_rim, pins, width, depth, platform = numbers
        assert told['bodies, covers'][0] == str(count)
        assert told['springs'][0] == str(springs)
        assert told['- of these between blocks'][0] == str(between)
        assert told['- of these to the rim'][0] == str(to_rim)
        assert told['steel pins in bodies, for hooks'][0] == str(pins)
        assert told['threaded rods in the rim, for hooks'][0] == str(to_rim)
        assert told['tubes of the rim, along x'][1].startswith(width)
        assert told['tubes of the rim, along y'][1].startswith(depth)
        assert told['platform, sandpaper of grain 120'][1].startswith(platform)
    plan = ezdxf.readfile(tmp_path / 'table.dxf').modelspace()
    drawn = [np.array(line.get_points('xy')) for line in plan.query('LWPOLYLINE[layer=="OUTLINE"]')]
    side = 1e3 * table.block_side_m
    blocks = [s.mean(axis=0) for s in drawn if np.ptp(s[:, 0]) == pytest.approx(side)]
    assert np.array(blocks) == pytest.approx(1e3 * table.rest[table.ids])
    rim = ezdxf.readfile(tmp_path / 'rim.dxf').modelspace()
    holes = sum(c.dxf.radius == 2 for c in rim.query('CIRCLE'))
    assert holes == int((table.springs[:, 1] < 0).sum())
    sizes = sorted({round(float(np.ptp(s[:, i])), 6) for s in drawn for i in (0, 1)})
    assert sizes[-1] == pytest.approx(1e3 * max(table.platform_m))
    square = table.rows == table.columns
    assert (tmp_path / 'jig_across.dxf').exists() != square
