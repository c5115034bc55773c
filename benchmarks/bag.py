# SPDX-License-Identifier: Apache-2.0
"""eol bench bag: decoding a bag's topics into columns, and messages one by one, against peers."""

import argparse
import gc
import importlib.util
import itertools
import time
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from support.paper import N_BLOCKS

from benchmarks.machine import tell
from eol_ros.analysis.bag import BATCH, Bag, open_bag
from eol_ros.core.motion.motion import NumberedSlip
from eol_ros.core.motion.slips import START, SlipEvent
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.vision.tracker import Tracked
from eol_ros.streams import blocks, images, slips, triggers
from eol_ros.streams.cdr import Decoder
from eol_ros.verbs.progress import track

HELP = "Measure the decoding of a bag's topics against mcap-ros2-support and rosbags."
EXAMPLES = ['eol bench bag', 'eol bench bag MY_BAG --repeats 9 --json']
SAMPLE = Path(__file__).parents[1] / 'bags' / 'sample'
STAMP_NS = 1_700_000_000_123_456_789


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('bag', nargs='?', default=str(SAMPLE), help='bag (default: bags/sample)')
    parser.add_argument('--repeats', type=int, default=5, help='number of runs; the fastest counts')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    bag = open_bag(args.bag)
    names = [name for name, count in bag.counts.items() if count]
    results = {
        'topics': [measure_topic(bag, name, args.repeats) for name in track(names, 'topics')],
        'messages': measure_messages(args.repeats),
    }
    tell(results, args.json, table)
    return 0


def best_us(call: Callable[[], Any], count: int, repeats: int) -> float:
    """Return the least processor time of `call` in us, divided by `count`."""
    spent = []
    gc.disable()
    try:
        for _ in range(repeats):
            begin = time.process_time_ns()
            call()
            spent.append(time.process_time_ns() - begin)
    finally:
        gc.enable()
    return min(spent) / count * 1e-3


def measure_topic(bag: Bag, name: str, repeats: int) -> dict[str, Any]:
    """Return the us a message that each decoder takes, and whether all find the same values.

    The peers make objects of Python; what it would take to make columns of those is not counted.
    """
    raw = [message.data for message in bag.messages([name])]
    topic = bag.topics[name]

    def columns() -> dict[str, np.ndarray]:
        decoder = Decoder(topic.type, topic.definition)  # as for each table: layouts start over
        found = {}
        for start in range(0, len(raw), BATCH):
            found = decoder.table(raw[start : start + BATCH])
        return found

    row: dict[str, Any] = {
        'topic': name,
        'messages': len(raw),
        'bytes': sum(map(len, raw)) / len(raw),
        'eol_us': best_us(columns, len(raw), repeats),
    }
    last = raw[(len(raw) - 1) // BATCH * BATCH :]
    for peer, make in (('mcap_ros2', mcap_ros2), ('rosbags', rosbags)):
        decode = make(topic.type, topic.definition)
        if decode is None:
            continue
        row[f'{peer}_us'] = best_us(lambda d=decode: [d(m) for m in raw], len(raw), repeats)
        row[f'{peer}_agrees'] = agree(columns(), [decode(message) for message in last])
    return row


def mcap_ros2(type_name: str, definition: str) -> Callable[[bytes], Any] | None:
    """Return the decoder of mcap-ros2-support; None where it is not installed."""
    if importlib.util.find_spec('mcap_ros2') is None:
        return None
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    schema = Schema(1, definition.encode(), 'ros2msg', type_name)
    return DecoderFactory().decoder_for('cdr', schema)


def rosbags(type_name: str, definition: str) -> Callable[[bytes], Any] | None:
    """Return the decoder of rosbags; None where it is not installed."""
    if importlib.util.find_spec('rosbags') is None:
        return None
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, type_name))
    return lambda raw: store.deserialize_cdr(raw, type_name)


def agree(columns: dict[str, np.ndarray], messages: list[Any]) -> bool:
    """Whether every column holds what the peer's objects do, floats to the bit.

    Of sequences of records, only those of one length, as in Blocks, are looked into.
    """

    def alike(mine: Any, theirs: Any) -> bool:
        if isinstance(mine, str):
            return mine == theirs
        if mine.dtype.names:
            return len(mine) == len(theirs)
        return np.array_equal(mine, list(theirs))

    def same(column: np.ndarray, values: list[Any]) -> bool:
        if column.dtype.names:
            inner = values if column.ndim == 1 else list(itertools.chain.from_iterable(values))
            return all(
                same(column[name].ravel(), [getattr(item, name) for item in inner])
                for name in column.dtype.names
            )
        if column.dtype.kind == 'M':
            return column.astype('i8').tolist() == [v.sec * 10**9 + v.nanosec for v in values]
        if column.dtype.kind == 'U':
            return column.tolist() == values
        if column.dtype == object:
            return all(map(alike, column, values))
        values = [list(v) if isinstance(v, bytes) else v for v in values]
        return np.array(values, column.dtype).tobytes() == np.ascontiguousarray(column).tobytes()

    heads = {'stamp', 'frame_id'} if hasattr(messages[0], 'header') else set()
    return all(
        same(column, [getattr(m.header if name in heads else m, name) for m in messages])
        for name, column in columns.items()
    )


def measure_messages(repeats: int, count: int = 300) -> list[dict[str, Any]]:
    """Return the us that one message takes to be made and read, and what rclpy's objects take."""
    if importlib.util.find_spec('eol_msgs') is None:
        return []
    from eol_msgs.msg import Block, Blocks, GrainTrigger, Slip
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import Image

    from eol_ros.ros.definitions import definition

    random = np.random.default_rng(1)
    xy, yaw, seen = random.normal(size=(2, 25, 2)), random.normal(size=25), random.random(25) < 0.5
    sigma = random.random(N_BLOCKS)
    answer = Tracked(1.0, xy[0], yaw, xy[1], seen, sigma, sigma.astype('f4'), 1, False)
    codec = blocks.Codec(definition(blocks.TYPE))

    def pack() -> bytes:
        rows = blocks.rows_of(answer, codec.rows)
        return codec.pack(STAMP_NS, answer.state, answer.symmetry_ambiguous, 5, rows)

    def objects() -> bytes:
        rows = blocks.rows_of(answer)
        names = rows.dtype.names or ()
        made = [Block(**dict(zip(names, row.item(), strict=True))) for row in rows]
        return serialize_message(Blocks(state=1, image=5, blocks=made))

    pictures = images.Codec(definition(images.TYPE))
    pixels = random.integers(0, 256, (800, 1280), dtype=np.uint8)

    def picture() -> bytes:
        data = array('B', pixels.tobytes())
        message = Image(height=800, width=1280, encoding='mono8', step=1280, data=data)
        return serialize_message(message)

    event = SlipEvent(START, 7, 12, 0.0, 1.7e9, 1e-3, 0.1, -0.2, 0.3)
    slip = NumberedSlip(event, 3, False)
    trigger = np.array([(1.0, 5, 0.1, 0.7, -0.3, 0.01, 0.2, 12)], TRIGGER)[0]

    def as_slip() -> Slip:
        return slips.RECORD.fill(Slip(), slips.of(STAMP_NS, slip))

    def as_trigger() -> GrainTrigger:
        return triggers.RECORD.fill(GrainTrigger(), triggers.of(STAMP_NS, 7, trigger))

    packed, shot = pack(), pictures.pack(STAMP_NS, pixels)
    said, row = as_slip(), as_trigger()
    calls: dict[str, tuple[Callable[[], Any], ...]] = {
        'blocks': (
            pack, lambda: codec.read(packed), objects,
            lambda: deserialize_message(packed, Blocks),
        ),
        'image, 1280x800': (
            lambda: pictures.pack(STAMP_NS, pixels), lambda: pictures.read(shot), picture,
            lambda: deserialize_message(shot, Image),
        ),
        'slip (a message object)': (as_slip, lambda: slips.RECORD.take(said)),
        'trigger (a message object)': (as_trigger, lambda: triggers.to_core(row, 1.0)),
    }  # fmt: skip
    names = ('make_us', 'read_us', 'rclpy_make_us', 'rclpy_read_us')
    found = []
    for record, each in calls.items():
        rounds = 30 if 'image' in record else count
        times = [
            best_us(lambda c=call, n=rounds: [c() for _ in range(n)], rounds, 4 * repeats)
            for call in each
        ]
        found.append({'record': record, **dict(zip(names, times, strict=False))})
    return found


def table(results: dict[str, Any]) -> str:
    """Return the results as text; processor time, least of the repeats."""
    lines = [
        'us a message: columns by streams/cdr.py, objects by mcap-ros2-support and by rosbags',
        f'{"topic":34}{"messages":>9}{"bytes":>8}{"eol":>8}{"mcap":>9}{"rosbags":>9}{"ratios":>13}',
    ]
    for row in results['topics']:
        words = f'{row["topic"]:34}{row["messages"]:>9}{row["bytes"]:>8.0f}{row["eol_us"]:>8.2f}'
        ratios = []
        for peer in ('mcap_ros2', 'rosbags'):
            if f'{peer}_us' not in row:
                words += f'{"-":>9}'
                continue
            words += f'{row[f"{peer}_us"]:>9.2f}'
            ratio = f'{row[f"{peer}_us"] / row["eol_us"]:.1f}'
            ratios.append(ratio if row[f'{peer}_agrees'] else f'{ratio} DIFFERS')
        lines.append(f'{words}{", ".join(ratios):>13}')
    lines += ['', 'us a message, one by one: made, read; the same by objects of rclpy']
    for row in results['messages']:
        words = ''.join(
            f'{row[name]:>10.2f}' if name in row else f'{"-":>10}'
            for name in ('make_us', 'read_us', 'rclpy_make_us', 'rclpy_read_us')
        )
        lines.append(f'{row["record"]:34}{words}')
    return '\n'.join(lines)
