# SPDX-License-Identifier: Apache-2.0
"""Each record against its definition, and against rclpy's message of it."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.paper import N_BLOCKS

from eol_ros.core.motion.cascades import CascadeEvent
from eol_ros.core.motion.felt import FeltSlip, Knock
from eol_ros.core.motion.motion import NumberedSlip
from eol_ros.core.motion.slips import SlipEvent
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.devices.board.lights import Sent, Tap
from eol_ros.errors import ConfigError
from eol_ros.settings import DESCRIPTORS
from eol_ros.streams import (
    calibrations,
    cascades,
    checks,
    corpus,
    felt,
    leds,
    slips,
    taps,
    triggers,
    work_state,
)
from eol_ros.streams.cdr import Decoder
from eol_ros.streams.definition import parse

ROOT = Path(__file__).parents[2]
MESSAGES = ROOT / 'msg_defs' / 'eol_msgs' / 'msg'
STAMP = 1_700_000_000_123_456_789
ONSET = 1_700_000_000.0625
RECORDS = [m.RECORD for m in (slips, felt, cascades, triggers, taps, leds, corpus, calibrations)]


def slip_row():
    event = SlipEvent(slips.STOP, 7, 12, 0.0, ONSET, 1e-3, 0.1, -0.2, 0.3, 0.04, 0.05)
    return slips.of(STAMP, NumberedSlip(event, 3, True))


def felt_row(kind=felt.CONFIRMED):
    knock = Knock(STAMP - 100_000_000, 12, 2e-4, 2.9)
    return felt.of(FeltSlip(kind, knock, 0.1, -0.2, 0.995, 7), STAMP)


def cascade_row():
    return cascades.of(STAMP, CascadeEvent(3, 0.0, ONSET, 0.5, 12, 2, 3, (12, 7), 0.25))


def trigger_row(block=12):
    trigger = np.array((1.0, 5, 0.1, 0.7, -0.3, 0.01, 0.2, block), TRIGGER)[()]
    return triggers.of(STAMP, 77, trigger)


def tap_row():
    return taps.of(Tap(STAMP, 24, 9.81, 2**32 - 1, 1e-4))


def led_row():
    return leds.of(Sent(9, bytes(range(N_BLOCKS)), True, STAMP, 1), STAMP + 5)


def corpus_row():
    random = np.random.default_rng(3)
    grains = np.zeros(4, GRAIN)
    for name in ('start_s', 'duration_s', 'x', *DESCRIPTORS[:-1]):
        grains[name] = random.random(4)
    grains['file'], grains['y'] = [0, 0, 1, 1], [0.5, np.nan, 0.25, 0.125]
    sources = Source('/a/ice.wav', 48000, 9.0), Source('/a/b.wav', 44100, 2.0)
    made = Corpus(sources, grains, digest='0f')
    return corpus.of(STAMP, made, (-0.5, -0.5, 0.5, 0.5), 0.06)


def calibrated(**more):
    heights = np.linspace(2.0, 9.0, N_BLOCKS * 4 * 33).reshape(N_BLOCKS, 4, 33) / 3
    covers = CoverOutlines(1 / 3, heights)
    ideal = Calibration.ideal(640, 400, mirror=True)
    lens = np.array([0.1, -0.02, 1e-3, 2e-3, 1 / 7])
    return dataclasses.replace(
        ideal, distortion_coefficients=lens, cover_height_m=0.1, date='2026-11-29',
        residual_px=0.1, residual_mm=1 / 3, covers=covers, **more,
    )  # fmt: skip


def calibration_row():
    return calibrations.of(STAMP, calibrated())


ROWS = {
    'Slip': slip_row, 'Cascade': cascade_row, 'GrainTrigger': trigger_row, 'BlockTap': tap_row,
    'LedCommand': led_row, 'Corpus': corpus_row, 'FeltSlip': felt_row,
    'Calibration': calibration_row,
}  # fmt: skip


@pytest.mark.parametrize('record', RECORDS, ids=lambda record: record.type)
def test_the_dtype_is_that_of_the_definition(record):
    text = (MESSAGES / f'{record.type.split("/")[-1]}.msg').read_text()
    head, rest = text.split('std_msgs/Header header', 1)
    decoder = Decoder(record.type, head + rest)
    fields = decoder.dtype(record.type.replace('/msg', ''))
    assert record.dtype.names == ('stamp', *fields.names)
    assert record.dtype['stamp'] == np.dtype('M8[ns]')
    for name in fields.names:
        assert record.dtype[name] == fields[name], name


def test_constants_are_those_of_the_definition():
    messages = pytest.importorskip('eol_msgs.msg')
    for module, kind, prefix, names in (
        (slips, messages.Slip, 'KIND_', ('START', 'STOP')),
        (felt, messages.FeltSlip, 'KIND_', ('PROVISIONAL', 'CONFIRMED', 'RETRACTED')),
        (felt, messages.FeltSlip, 'SENSE_', ('KNOCK', 'IMAGE')),
        (work_state, messages.NodeState, 'LEVEL_', ('OK', 'WARN', 'ERROR', 'STARTING')),
    ):
        for name in names:  # the old name stays for one release
            values = {getattr(kind, prefix + name), getattr(kind, name), getattr(module, name)}
            assert len(values) == 1
    text = (MESSAGES / 'GrainTrigger.msg').read_text()
    assert f'{triggers.NO_BLOCK} for none' in text


def test_a_definition_says_which_numbers_may_be_missing():
    rules = checks.rules(Table())
    for path in MESSAGES.glob('*.msg'):
        type_name = f'eol_msgs/msg/{path.stem}'
        fields = parse(path.read_text(), type_name)[f'eol_msgs/{path.stem}'].fields
        found = {field.name for field in fields if 'NaN' in field.comment}
        missing = {'x', 'y', 'u', 'v'} if path.stem == 'Block' else set()
        assert found == missing | set(rules.get(type_name, checks.Rule()).nan), path.stem


def test_rows_have_what_core_found():
    row = slip_row()
    head, onset, rest = row[:4], row[4], row[5:]
    assert (head, rest) == ((STAMP, 2, 7, 12), (1e-3, 0.1, -0.2, 0.3, 0.04, 0.05, 3, True))
    assert abs(onset - 1_700_000_000_062_500_000) < 240  # ns: what a float of seconds can tell
    row, first = felt_row(), felt_row(felt.PROVISIONAL)
    assert (row.stamp, row.sense) == (STAMP, felt.IMAGE)
    assert (first.stamp, first.sense) == (STAMP - 100_000_000, felt.KNOCK)
    assert row.onset == first.onset == first.stamp
    assert (row.block, row.x, row.y, row.slip) == (12, 0.1, -0.2, 7)
    assert row.strength == np.float32(2.9) and row.probability == np.float32(0.995)
    row = cascade_row()
    assert (row.cascade, row.nucleus, row.area, row.size) == (3, 12, 2, 3)
    assert (row.blocks.tolist(), row.distance) == ([12, 7], 0.25)
    row = trigger_row()
    assert (row.sequence, row.grain, row.block) == (77, 5, 12)
    for name, value in (('gain', 0.1), ('rate', 0.7), ('attack', 0.01), ('release', 0.2)):
        assert getattr(row, name) == np.float32(value)
    assert trigger_row(-1).block == triggers.NO_BLOCK
    row = led_row()
    assert (row.white.tolist(), row.sent) == (list(range(25)), STAMP + 5)
    row = corpus_row()
    assert (row.name, row.files) == ('ice.wav + 1', ['/a/ice.wav', '/a/b.wav'])
    assert row.values.shape == (4 * len(DESCRIPTORS),)


@pytest.mark.parametrize('covers', [True, False])
def test_a_calibration_comes_back_to_the_last_bit(covers):
    made = calibrated() if covers else dataclasses.replace(calibrated(), covers=None)
    row = calibrations.of(STAMP, made)
    (kept,) = calibrations.RECORD.each(calibrations.RECORD.rows([row]))
    for one in (row, kept):
        found = calibrations.to_core(one, Table())
        assert found.digest == made.digest == one.digest and found.mirrored
        for name in ('date', 'residual_px', 'residual_mm', 'cover_height_m', 'image_width'):
            assert getattr(found, name) == getattr(made, name)
    with pytest.raises(ConfigError, match='7 heights for 100 sides'):
        calibrations.to_core(row._replace(cover_land=np.ones(7)), Table())


@pytest.mark.parametrize('record', RECORDS, ids=lambda record: record.type)
def test_a_definition_names_the_frame(record):
    package, _, name = record.type.split('/')
    message = parse((MESSAGES / f'{name}.msg').read_text(), record.type)[f'{package}/{name}']
    assert message.fields[0].comment.endswith(f'; frame_id: {record.frame_id or "empty"}')


@pytest.mark.parametrize('name', ROWS)
def test_a_row_goes_through_rclpys_message_and_back(name):
    messages = pytest.importorskip('eol_msgs.msg')
    row = ROWS[name]()
    record = next(r for r in RECORDS if r.type.endswith(f'/{name}'))
    message = record.fill(getattr(messages, name)(), row)
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == STAMP
    assert message.header.frame_id == record.frame_id
    for mine, theirs in zip(record.take(message), row, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize('name', ROWS)
def test_a_bag_holds_the_row_that_was_sent(name):
    """The decoder of bags reads what rclpy serialised as `of` made it: live is offline."""
    messages = pytest.importorskip('eol_msgs.msg')
    from rclpy.serialization import serialize_message

    from eol_ros.ros.definitions import definition

    row = ROWS[name]()
    record = next(r for r in RECORDS if r.type.endswith(f'/{name}'))
    raw = serialize_message(record.fill(getattr(messages, name)(), row))
    table = Decoder(record.type, definition(record.type)).table([raw, raw])
    rows = record.rows([row, row])
    for field in record.dtype.names:
        for mine, theirs in zip(rows[field], table[field], strict=True):
            np.testing.assert_array_equal(mine, theirs, err_msg=field)
    first, _ = record.each(table)
    assert type(first) is type(row)
    assert record.rows([first]).dtype == record.dtype


def test_triggers_as_the_mixer_takes_them():
    """From a row, from a message and from a bag's table alike."""
    row = trigger_row()
    made = np.array([triggers.to_core(row, 2.5)], TRIGGER)[0]
    assert (made['time_s'], made['grain'], made['block']) == (2.5, 5, 12)
    assert (made['gain'], made['attack_s']) == (np.float32(0.1), np.float32(0.01))
    assert (made['rate'], made['release_s']) == (np.float32(0.7), np.float32(0.2))
    assert triggers.to_core(next(triggers.RECORD.each(triggers.RECORD.rows([row]))), 2.5) == (
        made.item()
    )
    assert triggers.to_core(trigger_row(-1), 0.0)[-1] == -1
    beyond = row._replace(grain=2**32 - 1)
    assert np.array([triggers.to_core(beyond, 0.0)], TRIGGER)['grain'] == 2**31 - 1


def test_taps_and_grains_as_core_takes_them():
    assert taps.to_core(tap_row()) == (STAMP * 1e-9, 24, 1e-4)
    (row,) = taps.RECORD.each(taps.RECORD.rows([tap_row()]))
    assert taps.to_core(row) == (STAMP * 1e-9, 24, float(np.float32(1e-4)))
    files, file, start, duration = corpus.to_core(corpus_row())
    assert files == ['/a/ice.wav', '/a/b.wav'] and file.tolist() == [0, 0, 1, 1]
    assert start.dtype == duration.dtype == np.float64 and len(start) == len(duration) == 4


def test_records_need_neither_ros_nor_messages(tmp_path):
    """All of streams is imported where rclpy and every package of messages is barred."""
    names = [f'eol_ros.streams.{path.stem}' for path in (ROOT / 'eol_ros/streams').glob('*.py')]
    code = (
        'import sys, importlib, importlib.abc\n'
        'class Bar(importlib.abc.MetaPathFinder):\n'
        '    def find_spec(self, name, path, target=None):\n'
        '        if name.split(".")[0].endswith(("_msgs", "rclpy", "interfaces")):\n'
        '            raise ImportError(name)\n'
        'sys.meta_path.insert(0, Bar())\n'
        f'[importlib.import_module(n) for n in {sorted(names)!r}]\n'
        'heavy = {"numba", "scipy", "cv2", "yaml", "rclpy"} & set(sys.modules)\n'
        'assert not heavy, heavy\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
