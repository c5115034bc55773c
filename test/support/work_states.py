# SPDX-License-Identifier: Apache-2.0
"""Every state of the work: states of nodes that make it, and its words in both languages."""

from eol_ros.said import code_and_args, said
from eol_ros.streams.work_state import ERROR, OK, STARTING, WARN


def row(level=OK, text='fine', rate=60.0, values=None):
    """Return the state of one node."""
    code, args = code_and_args(text)
    fields = {'text': text, 'code': code, 'args': args, 'rate': rate, 'values': values or {}}
    return {'level': level, **fields}


def running(**others):
    """Return the states of a work that is awake, with `others` in place."""
    nodes = ('twin', 'tracker', 'motion', 'leds', 'grains', 'sound', 'montage', 'panel')
    return {node: row() for node in nodes} | others


ASLEEP = row(values={'asleep': True})
HOURS = row(OK, said('asleep_until', day=said('tue'), time='10:00'))
STATES = {
    'starting': (running(sound=row(STARTING)), 'starting', '啟動中'),
    'test': (running(panel=row(values={'testing': True})), 'test running', '測試中'),
    'asleep': (running(montage=ASLEEP), 'asleep', '休眠中'),
    'asleep_until': (
        running(montage=ASLEEP, hours=HOURS), 'asleep until Tue 10:00', '休眠至週二 10:00',
    ),
    'work_fault': (
        running(leds=row(ERROR, said('no_board_answers', path='/dev/ttyUSB0'))),
        'fault: leds: no board answers on /dev/ttyUSB0',
        '故障：leds：/dev/ttyUSB0 上沒有控制板回應',
    ),
    'no_camera': (running(twin=row(WARN, rate=0.0)), 'no camera image', '沒有相機影像'),
    'no_sound_card': (
        running(sound=row(WARN, values={'card_missing': True})), 'no sound card', '沒有音效卡',
    ),
    'muted': (running(sound=row(values={'muted': True})), 'muted', '已靜音'),
    'awake': (running(), 'awake', '運作中'),
}  # fmt: skip
