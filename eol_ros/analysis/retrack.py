# SPDX-License-Identifier: Apache-2.0
"""Do the recorded pictures give the recorded results again? Bit for bit, by the same core code.

Images -> blocks -> slips, cascades and grain triggers are each a pure function of the sequence of
messages on one topic, so a bag of images proves or refutes its own results. It can do so only where
the recording began before the nodes saw their first message; where not, that is said.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml

from eol_ros.analysis.bag import Bag, Table
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.errors import ConfigError
from eol_ros.settings import by_today
from eol_ros.streams.graph import NODES

TRACKING = 1  # eol_msgs/Blocks.TRACKING
# The records that tracker, motion and grains hand each other, in the precision of the message.
BLOCK = np.dtype(
    [('x', 'f8'), ('y', 'f8'), ('yaw', 'f8'), ('u', 'f8'), ('v', 'f8'),
     ('sigma', 'f4'), ('visibility', 'f4'), ('seen', '?')], align=True
)  # fmt: skip
SLIP_FIELDS = (
    'kind', 'slip', 'block', 'onset', 'onset_sigma', 'x', 'y', 'speed', 'distance', 'duration',
    'cascade', 'tapped',
)  # fmt: skip
CASCADE_FIELDS = (
    'cascade', 'onset', 'duration', 'nucleus', 'area', 'size', 'blocks', 'distance'
)  # fmt: skip
TRIGGER_FIELDS = ('sequence', 'grain', 'block', 'gain', 'rate', 'pan', 'attack', 'release')


@dataclass
class Comparison:
    """One topic: how many messages were recorded and recomputed, and the first that differ."""

    topic: str
    recorded: int
    recomputed: int
    different: int = 0
    first: str = ''

    @property
    def equal(self) -> bool:
        """Whether every message is the same to the last bit."""
        return self.recorded == self.recomputed and not self.different


@dataclass
class Retracked:
    """What came of it; `notes` say what limits the proof."""

    topics: dict[str, Comparison] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def equal(self) -> bool:
        """Whether everything that could be compared is equal."""
        return all(c.equal for c in self.topics.values())


def settings_of(bag: Bag, node: str) -> Any:
    """Return the settings that `node` had in the recorded run; raise ConfigError if not known."""
    try:
        values = yaml.safe_load(bag.about['settings'])['nodes'][node]
        fields = {f.name for f in dataclasses.fields(NODES[node].settings)}
        known = by_today(NODES[node].settings, values)
        return NODES[node].settings(
            **{k: tuple(v) if isinstance(v, list) else v for k, v in known.items() if k in fields}
        )
    except (KeyError, TypeError, yaml.YAMLError):
        raise ConfigError(
            f'{bag.path}: says nothing of the settings of {node}; it was recorded without its scene'
        ) from None


def retrack(bag: Bag, track: Callable[[Iterable, str, int], Iterable] | None = None) -> Retracked:
    """Recompute what the bag has the input for, and compare; `track` shows the progress.

    Raises ConfigError when the bag has no blocks.
    """
    result = Retracked()
    blocks = bag.table('blocks')
    if not len(blocks):
        raise ConfigError(f'{bag.path}: no blocks in it; nothing to compare')
    if blocks['image'][0] != 0:
        result.notes.append(
            f'the recording began with image {blocks["image"][0]} of the tracker: '
            'what it knew by then is not in the bag'
        )
    if bag.counts.get('/eol/camera/image_raw'):
        _compare_blocks(bag, blocks, result, track)
    else:
        result.notes.append('no pictures in the bag: compared from its blocks on')
    inputs = list(_inputs(blocks))
    _compare_motion(bag, inputs, result)
    if bag.counts.get('/eol/grain_triggers'):
        _compare_triggers(bag, inputs, result)
    return result


def _compare_blocks(bag: Bag, blocks: Table, result: Retracked, track: Any) -> None:
    from eol_ros.core.vision.tracker import Tracker
    from eol_ros.devices.files.tracker_files import calibration_of

    settings = settings_of(bag, 'tracker')
    tracker = Tracker(settings, calibration_of(settings))
    for request in _requests(bag):
        tracker.requests.add(*request)
    row_of = {int(stamp): i for i, stamp in enumerate(blocks['stamp'].astype('i8'))}
    check = Comparison('blocks', len(blocks), 0)
    pictures = images(bag)
    if track:
        pictures = track(pictures, 'tracking', bag.counts['/eol/camera/image_raw'])
    taps = _taps(bag)
    for log_ns, stamp_ns, image in pictures:
        while taps and taps[0][0] <= log_ns:
            tracker.tap(*taps.pop(0)[1:])
        row = row_of.get(stamp_ns)
        if row is None:  # the tracker never saw it
            continue
        if row != check.recomputed:  # it saw one that is not here: from there on it knew more
            break
        tracked = tracker.update(stamp_ns * 1e-9, image)
        check.recomputed += 1
        mine = np.zeros(N_BLOCKS, BLOCK)
        mine['x'], mine['y'] = tracked.world[:, 0], tracked.world[:, 1]
        mine['u'], mine['v'] = tracked.px[:, 0], tracked.px[:, 1]
        mine['yaw'], mine['sigma'] = tracked.yaw, tracked.sigma_m
        mine['visibility'], mine['seen'] = tracked.visibility, tracked.seen
        theirs = blocks[row]
        wrong = [n for n in BLOCK.names or () if not _same(mine[n], theirs['blocks'][n])]
        if tracked.state != theirs['state']:
            wrong.append('state')
        if tracked.symmetry_ambiguous != theirs['symmetry_ambiguous']:
            wrong.append('symmetry_ambiguous')
        if wrong:
            check.different += 1
            check.first = check.first or f'image {theirs["image"]}: {", ".join(wrong)}'
    if check.recomputed < check.recorded:
        result.notes.append(
            f'blocks compared up to image {check.recomputed} of {check.recorded}: the picture of '
            'the next is not in the bag'
        )
        check.recorded = check.recomputed
    result.topics['blocks'] = check


def _requests(bag: Bag) -> list[tuple[int, str, str]]:
    """Return what the tracker said it heeded: stamp in ns from which on, what, and how."""
    if '/eol/control' not in bag.topics:
        return []
    table = bag.table('control')
    mine = (table['source'] == 'tracker') & (table['command'] == 'set')
    return [
        (int(ns), str(key), str(value))
        for ns, key, value in zip(
            table['stamp'].astype('i8')[mine], table['key'][mine], table['value'][mine], strict=True
        )
    ]


def _taps(bag: Bag) -> list[tuple[int, float, int, float]]:
    """Return log time in ns, stamp in s, block and sigma in s of every recorded tap."""
    if '/eol/block_taps' not in bag.topics:
        return []
    table = bag.table('block_taps')
    return list(
        zip(
            table['log_time'].astype('i8').tolist(),
            [ns * 1e-9 for ns in table['stamp'].astype('i8').tolist()],
            table['block'].tolist(),
            table['sigma'].tolist(),
            strict=True,
        )
    )


def images(bag: Bag) -> Iterator[tuple[int, int, np.ndarray]]:
    """Yield log time and stamp in ns and the (h, w) uint8 pixels of every recorded mono8 image."""
    name = bag.find('camera/image_raw')
    decoder, place, shape = bag.decoder(name), 0, (0, 0)
    size = -1
    for message in bag.messages([name]):
        if len(message.data) != size:  # the first, or another camera
            row = decoder.table([message.data])
            shape = int(row['height'][0]), int(row['width'][0])
            if row['encoding'][0] not in ('mono8', '8UC1') or row['step'][0] != shape[1]:
                raise ConfigError(f'{bag.path}: images are {row["encoding"][0]}, not mono8')
            place, size = decoder.offset('data', message.data), len(message.data)
        seconds, nanoseconds = np.frombuffer(message.data, '<i4', 2, 4).tolist()
        pixels = np.frombuffer(message.data, np.uint8, shape[0] * shape[1], place)
        yield message.log_ns, seconds * 10**9 + nanoseconds, pixels.reshape(shape)


def _inputs(blocks: Table) -> Iterator[tuple[int, int, np.ndarray, np.ndarray]]:
    """Yield what motion and grains take: log time, stamp, block records, which are seen."""
    stamps, logs = blocks['stamp'].astype('i8').tolist(), blocks['log_time'].astype('i8').tolist()
    for row, stamp_ns, log_ns in zip(blocks, stamps, logs, strict=True):
        record = np.zeros(N_BLOCKS, BLOCK)
        for name in BLOCK.names or ():
            record[name] = row['blocks'][name]
        yield log_ns, stamp_ns, record, record['seen'] & (row['state'] == TRACKING)


def _compare_motion(bag: Bag, inputs: list, result: Retracked) -> None:
    from eol_ros.core.motion.motion import Motion

    if not any('/eol/' + t in bag.topics for t in ('slips', 'cascades')):
        return
    motion = Motion(settings_of(bag, 'motion'))
    waiting = _taps(bag)
    slips, cascades = [], []
    for log_ns, stamp_ns, record, seen in inputs:
        while waiting and waiting[0][0] <= log_ns:
            motion.tap(*waiting.pop(0)[1:])
        new, closed = motion.update(
            stamp_ns * 1e-9, record['x'], record['y'], seen, record['sigma']
        )
        for slip in new:
            e = slip.event
            slips.append((
                e.kind, e.slip, e.block, round(e.onset_s * 1e9), e.onset_sigma_s, e.x, e.y,
                e.speed_mps, e.distance_m, e.duration_s, slip.cascade, slip.tapped,
            ))  # fmt: skip
        for c in closed:
            cascades.append((
                c.cascade, round(c.onset_s * 1e9), c.duration_s, c.nucleus, c.area, c.size,
                c.blocks, c.distance_m,
            ))  # fmt: skip
    _compare(bag, 'slips', SLIP_FIELDS, slips, result)
    _compare(bag, 'cascades', CASCADE_FIELDS, cascades, result)


def _compare_triggers(bag: Bag, inputs: list, result: Retracked) -> None:
    from eol_ros.core.sound.select import Selector
    from eol_ros.devices.corpus import corpus_build
    from eol_ros.devices.corpus.loader import wish_of

    settings = settings_of(bag, 'grains')
    corpus = corpus_build.apart(*wish_of(settings))
    recorded = bag.table('corpus')
    if len(recorded) and recorded['digest'][-1] != corpus.digest:
        result.notes.append('the corpus of the run is not here: its sound has another digest')
        return
    selector = Selector(settings)
    selector.load(corpus)
    rows: list[tuple] = []
    for _log_ns, stamp_ns, record, seen in inputs:
        found = selector.update(stamp_ns * 1e-9, record['x'], record['y'], seen, record['sigma'])
        for t in found:
            rows.append((
                len(rows), t['grain'], t['block'], t['gain'], t['rate'], t['pan'], t['attack_s'],
                t['release_s'],
            ))  # fmt: skip
    _compare(bag, 'grain_triggers', TRIGGER_FIELDS, rows, result)


def _compare(bag: Bag, topic: str, names: tuple[str, ...], mine: list, result: Retracked) -> None:
    """Compare recomputed rows with the recorded messages, field by field, as the message stores."""
    table = bag.table(topic)
    check = Comparison(topic, len(table), len(mine))
    for number, (theirs, row) in enumerate(zip(table, mine, strict=False)):
        wrong = []
        for name, value in zip(names, row, strict=True):
            stored = np.asarray(theirs[name])
            if stored.dtype.kind == 'M':
                stored = stored.astype('i8')
            if not _same(np.asarray(value).astype(stored.dtype), stored):
                wrong.append(f'{name} {stored} and {value}')
        if wrong:
            check.different += 1
            check.first = check.first or f'number {number}: {"; ".join(wrong)}'
    result.topics[topic] = check


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two arrays are equal to the last bit, NaN to NaN."""
    floats = a.dtype.kind == 'f'
    return a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=floats))
