# SPDX-License-Identifier: Apache-2.0
"""Do the recorded images give the recorded results again? Bit for bit, by the same core code.

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
from eol_ros.devices.bag.requests import heeded
from eol_ros.errors import ConfigError
from eol_ros.settings import by_today
from eol_ros.streams import cascades, slips, taps, triggers
from eol_ros.streams.blocks import DTYPE, Blocks, each
from eol_ros.streams.blocks import of as blocks_row
from eol_ros.streams.graph import NODES
from eol_ros.streams.images import Codec
from eol_ros.streams.requests import SET, Asked, Heeded, for_tracker

CHUNK = 512  # images compared at a time


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

    def compare(self, mine: np.ndarray, theirs: np.ndarray, name: Callable[[int], str]) -> None:
        """Compare rows (n,) with as many recorded ones, column by column; `name` names a row."""
        unequal = dict(_unequal(mine, theirs))
        rows = np.logical_or.reduce([np.zeros(len(mine), bool), *unequal.values()])
        self.different += int(rows.sum())
        if rows.any() and not self.first:
            row = int(rows.argmax())
            wrong = [
                f'{column} {theirs[column][row]} and {mine[column][row]}'
                if column in (mine.dtype.names or ())
                else column
                for column, where in unequal.items()
                if where[row]
            ]
            self.first = f'{name(row)}: {"; ".join(wrong)}'


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
    lines = heeded(bag)
    for node in ('motion', 'grains'):
        if any(h.asked.kind == SET and h.asked.node == node and not h.asked.id for h in lines):
            result.notes.append(
                f'settings of {node} were changed while recording; a bag of that version does not '
                'say from which image on'
            )
    if bag.count('camera/image_raw'):
        _compare_blocks(bag, lines, blocks, result, track)
    else:
        result.notes.append('no images in the bag: compared from its blocks on')
    inputs = list(zip(blocks['log_time'].astype('i8').tolist(), each(blocks), strict=True))
    _compare_motion(bag, lines, inputs, result)
    if bag.count('grain_triggers'):
        _compare_triggers(bag, lines, inputs, result)
    return result


def _compare_blocks(
    bag: Bag, lines: list[Heeded], blocks: Table, result: Retracked, track: Any
) -> None:
    from eol_ros.core.vision.tracker import Tracker

    settings = settings_of(bag, 'tracker')
    tracker = Tracker(settings, _calibration(bag, settings))
    for asked in _accepted(lines, 'tracker'):
        for kind, value in for_tracker(asked):
            tracker.requests.add(asked.from_ns, kind, value)
    row_of = {int(stamp): i for i, stamp in enumerate(blocks['stamp'].astype('i8'))}
    check = Comparison('blocks', len(blocks), 0)
    pictures = images(bag)
    if track:
        pictures = track(pictures, 'tracking', bag.count('camera/image_raw'))
    waiting = _taps(bag)
    mine: list[np.void] = []

    def compare() -> None:
        theirs = blocks[check.recomputed - len(mine) : check.recomputed]
        check.compare(np.array(mine, DTYPE), theirs, lambda row: f'image {theirs["image"][row]}')
        mine.clear()

    for log_ns, stamp_ns, image in pictures:
        while waiting and waiting[0][0] <= log_ns:
            tracker.tap(*waiting.pop(0)[1:])
        row = row_of.get(stamp_ns)
        if row is None:  # the tracker never saw it
            continue
        if row != check.recomputed:  # it saw one that is not here: from there on it knew more
            break
        tracked = tracker.update(stamp_ns * 1e-9, image)
        check.recomputed += 1
        mine.append(blocks_row(stamp_ns, tracked, blocks['image'][row]))
        if len(mine) == CHUNK:
            compare()
    if mine:
        compare()
    if check.recomputed < check.recorded:
        result.notes.append(
            f'blocks compared up to image {check.recomputed} of {check.recorded}: the image of '
            'the next is not in the bag'
        )
        check.recorded = check.recomputed
    result.topics['blocks'] = check


def _calibration(bag: Bag, settings: Any) -> Any:
    """Return the calibration that the tracker began with: that in the bag, else in its file."""
    from eol_ros.devices.files import calibration_file
    from eol_ros.devices.files.tracker_files import calibration_of

    if not bag.count('calibration'):
        return calibration_of(settings)
    where = f'{bag.path}: {bag.name("calibration")}'
    return calibration_file.loads(str(bag.table('calibration')['data'][0]), where)


def _accepted(lines: list[Heeded], node: str) -> list[Asked]:
    """Return what a node was asked and accepted, in order of the stamp from which it counted."""
    found = [h.asked for h in lines if h.accepted and h.asked.node == node]
    return sorted(found, key=lambda asked: asked.from_ns)


class _Live:
    """The settings of a node as they were changed while it ran; `at` each stamp in turn."""

    def __init__(self, bag: Bag, lines: list[Heeded], node: str):
        self.settings = settings_of(bag, node)
        self._changes = [asked for asked in _accepted(lines, node) if asked.kind == SET]

    def at(self, stamp_ns: int) -> bool:
        """Take what counts from `stamp_ns` on; return whether anything has changed."""
        changed = False
        while self._changes and self._changes[0].from_ns <= stamp_ns:
            values = self._changes.pop(0).values
            self.settings = dataclasses.replace(self.settings, **values)
            changed = True
        return changed


def _taps(bag: Bag) -> list[tuple[int, float, int, float]]:
    """Return log time in ns, stamp in s, block and sigma in s of every recorded tap."""
    if bag.name('block_taps') not in bag.topics:
        return []
    table = bag.table('block_taps')
    logs = table['log_time'].astype('i8').tolist()
    return [(at, *taps.to_core(row)) for at, row in zip(logs, taps.RECORD.each(table), strict=True)]


def images(bag: Bag) -> Iterator[tuple[int, int, np.ndarray]]:
    """Yield log time and stamp in ns and the (h, w) uint8 pixels of every recorded mono8 image."""
    name = bag.find('camera/image_raw')
    codec = Codec(bag.topics[name].definition)
    for message in bag.messages([name]):
        try:
            stamp_ns, pixels = codec.read(message.data)
        except ValueError as error:
            raise ConfigError(f'{bag.path}: {error}') from None
        yield message.log_ns, stamp_ns, pixels


def _compare_motion(
    bag: Bag, lines: list[Heeded], inputs: list[tuple[int, Blocks]], result: Retracked
) -> None:
    from eol_ros.core.motion.motion import Motion

    if not any(bag.name(topic) in bag.topics for topic in ('slips', 'cascades')):
        return
    live = _Live(bag, lines, 'motion')
    motion = Motion(live.settings)
    waiting = _taps(bag)
    new, over = [], []
    for log_ns, image in inputs:
        while waiting and waiting[0][0] <= log_ns:
            motion.tap(*waiting.pop(0)[1:])
        if live.at(image.stamp_ns):
            motion.set(live.settings)
        rows = image.rows
        begun, closed = motion.update(
            image.stamp_s, rows['x'], rows['y'], image.known, rows['sigma']
        )
        new += [slips.of(image.stamp_ns, slip) for slip in begun]
        over += [cascades.of(image.stamp_ns, cascade) for cascade in closed]
    _compare(bag, 'slips', slips.RECORD.rows(new), result)
    _compare(bag, 'cascades', cascades.RECORD.rows(over), result)


def _compare_triggers(
    bag: Bag, lines: list[Heeded], inputs: list[tuple[int, Blocks]], result: Retracked
) -> None:
    from eol_ros.core.sound.select import Selector
    from eol_ros.devices.corpus import corpus_build
    from eol_ros.devices.corpus.loader import corpus_spec

    live = _Live(bag, lines, 'grains')
    corpus = corpus_build.apart(*corpus_spec(live.settings))
    recorded = bag.table('corpus')
    if len(recorded) and recorded['digest'][0] != corpus.digest:
        result.notes.append('the corpus of the run is not here: its sound has another digest')
        return
    # A corpus made while recording took as long as it took: from there on this proves nothing.
    other = recorded[recorded['digest'] != corpus.digest]
    until_ns = int(other['stamp'][0].astype('i8')) if len(other) else 2**63 - 1
    selector = Selector(live.settings)
    selector.load(corpus)
    made: list = []
    for _log_ns, image in inputs:
        if image.stamp_ns >= until_ns:
            result.notes.append(
                f'grain triggers compared up to number {len(made)} of '
                f'{bag.count("grain_triggers")}: then the run went over to another corpus'
            )
            break
        if live.at(image.stamp_ns):
            selector.settings = live.settings
        rows = image.rows
        found = selector.update(image.stamp_s, rows['x'], rows['y'], image.known, rows['sigma'])
        for trigger in found:
            made.append(triggers.of(image.stamp_ns, len(made), trigger))
    _compare(bag, 'grain_triggers', triggers.RECORD.rows(made), result, until_ns)


def _compare(
    bag: Bag, topic: str, mine: np.ndarray, result: Retracked, until_ns: int = 2**63 - 1
) -> None:
    """Compare recomputed rows with the recorded messages.

    Of the messages only those of stamps before `until_ns` count, and none that no block caused.
    """
    table = bag.table(topic)
    table = table[table['stamp'].astype('i8') < until_ns]
    if topic == 'grain_triggers':
        table = table[table['block'] != triggers.NO_BLOCK]
    check = Comparison(topic, len(table), len(mine))
    both = min(len(table), len(mine))
    check.compare(mine[:both], table[:both], lambda row: f'number {row}')
    result.topics[topic] = check


def _unequal(mine: np.ndarray, theirs: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield each column of `mine`, (n,) rows, and where it is not that of `theirs`, bit for bit.

    NaN is equal to NaN. Columns of records are looked into.
    """
    for name in mine.dtype.names or ():
        a, b = mine[name], np.asarray(theirs[name])
        if a.dtype.names:
            yield from _unequal(a, b)
        elif a.dtype == object:
            pairs = zip(a, b, strict=True)
            yield name, np.array([not np.array_equal(x, y) for x, y in pairs], bool)
        else:
            a = a.astype(b.dtype, copy=False)
            where = a != b
            if a.dtype.kind == 'f':
                where &= ~(np.isnan(a) & np.isnan(b))
            yield name, where.any(axis=tuple(range(1, where.ndim)))
