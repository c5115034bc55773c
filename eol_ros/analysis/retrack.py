# SPDX-License-Identifier: Apache-2.0
"""Do the recorded images give the recorded results again? Bit for bit, by the same core code.

Images -> blocks -> slips, cascades and grain triggers are each a pure function of the sequence of
messages on one topic, so a bag of images proves or refutes its own results. It can do so only where
the recording began before the nodes saw their first message; where not, that is said.
"""

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eol_ros.analysis.bag import Bag, Table
from eol_ros.analysis.recorded_settings import recorded_settings, recorded_table
from eol_ros.core.motion.felt import Knock
from eol_ros.devices.bag.requests import heeded
from eol_ros.errors import ConfigError
from eol_ros.streams import calibrations, cascades, felt, slips, taps, triggers
from eol_ros.streams.blocks import Blocks, each
from eol_ros.streams.blocks import of as blocks_row
from eol_ros.streams.images import Codec
from eol_ros.streams.requests import SET, Asked, Heeded, for_tracker

CHUNK = 512  # images compared at a time
LOST_AT_ONCE = 60  # images that are kept until it is known whether the tracker saw them


EQUAL, PART, DIFFERENT = 'equal', 'part', 'different'
SHOWN = 20  # holes that are named one by one
# Largest difference of floats, as a share of their column's largest value, that another processor,
# Python or library explains: some steps of single precision. Other data differ by much more.
ROUNDING = 1e-6


@dataclass
class Comparison:
    """One topic: how many messages were recorded and recomputed, and the first that differ.

    `proved` is the number of recorded messages whose inputs are all in the bag; `apart` is the
    largest difference of a float as a share of its column's largest value, infinite if anything
    else differs. `lost_input` names inputs that the recorder knows to be lost, no one knows which:
    a difference then proves nothing.
    """

    topic: str
    recorded: int
    recomputed: int
    different: int = 0
    first: str = ''
    proved: int = 0
    apart: float = 0.0
    lost_input: str = ''

    @property
    def verdict(self) -> str:
        """EQUAL to the last bit, DIFFERENT, or no difference in the PART that can be proved."""
        if self.different or self.recomputed != self.proved:
            return PART if self.lost_input else DIFFERENT
        return EQUAL if self.proved == self.recorded else PART

    @property
    def equal(self) -> bool:
        """Whether every recorded message was recomputed and is the same to the last bit."""
        return self.verdict == EQUAL

    @property
    def rounding(self) -> bool:
        """Whether only last digits of floats differ."""
        return self.recomputed == self.proved and 0 < self.apart <= ROUNDING

    def words(self) -> str:
        """Return it for people."""
        if self.lost_input and (self.different or self.recomputed != self.proved):
            return f'not determined by the bag, which lacks {self.lost_input}'
        if self.different and self.rounding:
            least = f'by at most {self.apart:.0e} of the largest value, as with other rounding'
            return f'{self.different} differ {least}, {self.first}'
        if self.different:
            return f'{self.different} differ, {self.first}'
        if self.verdict == DIFFERENT:
            return f'counts differ: {self.recomputed} came of what gave {self.proved}'
        if self.verdict == PART:
            return f'{self.proved} of {self.recorded} proved, no difference in these'
        return 'equal to the last bit'

    def compare(self, mine: np.ndarray, theirs: np.ndarray, name: Callable[[int], str]) -> None:
        """Compare rows (n,) with as many recorded ones, column by column; `name` names a row."""
        if not len(mine):
            return
        unequal = {}
        for column, where, apart in _unequal(mine, theirs):
            unequal[column] = where
            self.apart = max(self.apart, apart)
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
    """What came of it.

    notes: what limits the proof. holes: where the bag lacks what a node had, in words. images: how
    many the tracker saw, how many of these the bag lacks, and how many it has that the tracker did
    not see; empty for a bag that keeps none.
    """

    topics: dict[str, Comparison] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    holes: list[str] = field(default_factory=list)
    images: dict[str, int] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """EQUAL, DIFFERENT, or no difference in the PART that can be proved."""
        verdicts = {check.verdict for check in self.topics.values()}
        if DIFFERENT in verdicts:
            return DIFFERENT
        return EQUAL if verdicts == {EQUAL} and not self.notes and not self.holes else PART

    @property
    def equal(self) -> bool:
        """Whether the whole bag is proved, and equal to the last bit."""
        return self.verdict == EQUAL

    def words(self) -> str:
        """Return the verdict for people."""
        return {
            EQUAL: 'equal to the last bit',
            PART: 'no difference in the part that can be proved',
            DIFFERENT: 'NOT equal',
        }[self.verdict]


def settings_of(bag: Bag, node: str) -> Any:
    """Return the settings that `node` had in the recorded run; raise ConfigError if not known."""
    found = recorded_settings(bag, node)
    if found is None:
        raise ConfigError(
            f'{bag.path}: says nothing of the settings of {node}; it was recorded without its scene'
        )
    return found


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
    _name_losses(bag, result)
    lines = heeded(bag)
    if bag.count('camera/image_raw'):
        _compare_blocks(bag, lines, blocks, result, track)
    else:
        result.notes.append('no images in the bag: compared from its blocks on')
    inputs = list(each(blocks))
    broken = np.flatnonzero(np.diff(blocks['image'].astype('i8')) != 1)
    until_ns = 2**63 - 1
    if len(broken):  # behind it motion and grains knew more than the bag has
        inputs = inputs[: broken[0] + 1]
        until_ns = int(blocks['stamp'][broken[0]].astype('i8')) + 1
    _name_lost_blocks(blocks, broken, result)
    _compare_motion(bag, lines, inputs, result, until_ns)
    if bag.count('grain_triggers'):
        _compare_triggers(bag, lines, inputs, result, until_ns)
    return result


def _losses(bag: Bag, topic: str) -> int:
    """Return how many messages of `topic` the recorder knows to be lost."""
    counts = (bag.gaps.get(kind, '{}') for kind in ('lost_before_recorder', 'dropped_in_recorder'))
    return sum(int(json.loads(text).get(bag.name(topic), 0)) for text in counts)


def _name_losses(bag: Bag, result: Retracked) -> None:
    for topic in ('block_taps', *KEYS):
        if lost := _losses(bag, topic):
            result.holes.append(f'not in the bag: {lost} of {topic}, by the count of the recorder')
    if lost := _losses(bag, 'requests'):
        result.notes.append(f'not in the bag: {lost} of requests, whose answers it has')


def _name_lost_blocks(blocks: Table, broken: np.ndarray, result: Retracked) -> None:
    """Say where the numbers of the tracker's images, which its answers carry, leave some out."""
    numbers, start_ns = blocks['image'].astype('i8'), int(blocks['stamp'][0].astype('i8'))
    found = []
    for row in broken:
        before, after = int(numbers[row]), int(numbers[row + 1])
        at_s = (int(blocks['stamp'][row + 1].astype('i8')) - start_ns) * 1e-9
        if after > before:
            span = _span(before + 1, after - 1)
            found.append(f'not in the bag: blocks of {span}, before {at_s:.3f} s')
        else:
            found.append(f'the tracker was started again at {at_s:.3f} s, after image {before}')
    _name(found, result)


def _span(first: int, last: int) -> str:
    return f'image {first}' if first == last else f'images {first} to {last} ({last - first + 1})'


def _name(found: list[str], result: Retracked) -> None:
    result.holes += found[:SHOWN]
    if len(found) > SHOWN:
        result.holes.append(f'and {len(found) - SHOWN} more such holes')


def _compare_blocks(
    bag: Bag, lines: list[Heeded], blocks: Table, result: Retracked, track: Any
) -> None:
    from eol_ros.core.vision.tracker import Tracker

    settings = settings_of(bag, 'tracker')
    tracker = Tracker(settings, _calibration(bag, settings), recorded_table(bag))
    for asked in _accepted(lines, 'tracker'):
        for kind, value in for_tracker(asked):
            tracker.requests.add(asked.from_ns, kind, value)
    stamps = blocks['stamp'].astype('i8')
    numbers = blocks['image'].astype('i8')
    check = Comparison('blocks', len(blocks), 0)
    offset_ns = round(settings.stamp_offset_s * 1e9)
    pictures: Iterable = ((stamp + offset_ns, pixels) for stamp, pixels in images(bag))
    if track:
        pictures = track(pictures, 'tracking', bag.count('camera/image_raw'))
    waiting = _taps(bag)
    mine: list[np.void] = []
    there: list[int] = []  # stamps of the images in the bag

    def compare() -> None:
        theirs = blocks[check.recomputed - len(mine) : check.recomputed]
        rows = np.array(mine, mine[0].dtype)
        check.compare(rows, theirs, lambda row: f'image {theirs["image"][row]}')
        mine.clear()

    for row, stamp_ns, image in _seen(pictures, stamps, numbers, there):
        while waiting and waiting[0].stamp_ns <= stamp_ns:
            knock = waiting.pop(0)
            tracker.tap(knock.stamp_s, knock.block, knock.sigma_s)
        tracked = tracker.update(stamp_ns * 1e-9, image)
        if row is None:
            continue
        check.recomputed += 1
        mine.append(blocks_row(stamp_ns, tracked, blocks['image'][row]))
        if len(mine) == CHUNK:
            compare()
    if mine:
        compare()
    check.proved = check.recomputed
    if check.recomputed < check.recorded:
        result.notes.append(
            f'blocks compared up to number {check.recomputed} of {check.recorded}: what the '
            'tracker saw next is not in the bag, or not known'
        )
    _name_lost_images(stamps, numbers, np.array(there, 'i8'), result)
    result.topics['blocks'] = check


def _seen(
    pictures: Iterable[tuple[int, np.ndarray]],
    stamps: np.ndarray,
    numbers: np.ndarray,
    there: list[int],
) -> Iterator[tuple[int | None, int, np.ndarray]]:
    """Yield the images as the tracker saw them: number of the blocks that answer it, stamp, image.

    None stands for an answer that is lost. It ends where the tracker saw what is not here, or not
    known: from there on it knew more. stamps, numbers: (n,) of the recorded blocks. `there` gets
    the stamps of all images in the bag.
    """
    row_of = {int(stamp): i for i, stamp in enumerate(stamps)}
    unanswered: list[tuple[int, np.ndarray]] = []  # the last of those since one was answered
    many, answered, known = 0, 0, True
    for stamp_ns, image in pictures:
        there.append(stamp_ns)
        row = row_of.get(stamp_ns)
        if not known:
            continue
        if row is None:  # the tracker never saw it, or its answer is lost
            many += 1
            unanswered = [*unanswered, (stamp_ns, image)][-LOST_AT_ONCE:]
            continue
        # It saw so many in between, by its own count; the first may be that of a later start.
        seen = int(numbers[row] - numbers[row - 1]) - 1 if row else 0
        if row != answered or seen not in (0, many) or seen > len(unanswered):
            known = False
            continue
        for lost in unanswered if seen else ():
            yield None, *lost
        yield row, stamp_ns, image
        unanswered, many, answered = [], 0, answered + 1


def _name_lost_images(
    stamps: np.ndarray, numbers: np.ndarray, there: np.ndarray, result: Retracked
) -> None:
    """Count the images that the tracker saw and the bag lacks, and name each run of them.

    stamps, numbers: (n,) of the recorded blocks. there: (m,) stamps of the images in the bag.
    """
    lacking = ~np.isin(stamps, there)
    extra = np.sort(there[~np.isin(there, stamps)])  # not seen, or the answer is not in the bag
    skipped = np.maximum(np.diff(numbers) - 1, 0)  # answers that are not in the bag
    between = np.diff(np.searchsorted(extra, stamps))
    unknown = np.maximum(skipped - between, 0)  # neither answer nor image
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lacking, [0]])))
    found = [
        f'{_span(int(numbers[first]), int(numbers[end - 1]))}, from '
        f'{(stamps[first] - stamps[0]) * 1e-9:.3f} s on'
        for first, end in edges.reshape(-1, 2)
    ]
    found += [
        f'{unknown[row]} between images {numbers[row]} and {numbers[row + 1]}, before '
        f'{(stamps[row + 1] - stamps[0]) * 1e-9:.3f} s'
        for row in np.flatnonzero(unknown)
    ]
    _name([f'the tracker saw it, the bag lacks it: {one}' for one in found], result)
    result.images = {
        'seen': len(stamps) + int(skipped.sum()),
        'lacking': int(lacking.sum() + unknown.sum()),
        'not_seen': int(np.maximum(between - skipped, 0).sum()),
    }


def _calibration(bag: Bag, settings: Any) -> Any:
    """Return the calibration that the tracker began with: that in the bag, else in its file."""
    from eol_ros.devices.files import calibration_file
    from eol_ros.devices.files.tracker_files import calibration_of

    if not bag.count('calibration'):
        return calibration_of(settings, recorded_table(bag))
    rows = bag.table('calibration')
    if 'data' in (rows.dtype.names or ()):  # YAML, as up to version 0.2
        where = f'{bag.path}: {bag.name("calibration")}'
        return calibration_file.loads(str(rows['data'][0]), where)
    return calibrations.to_core(next(calibrations.RECORD.each(rows)), recorded_table(bag))


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


def _taps(bag: Bag) -> list[Knock]:
    """Return every recorded tap, in order of stamps.

    Not as they were recorded: the recorder may have had other things to do when they came.
    """
    if bag.name('block_taps') not in bag.topics:
        return []
    return sorted(map(taps.to_knock, taps.RECORD.each(bag.table('block_taps'))))


def images(bag: Bag) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the stamp in ns and the grey (h, w) uint8 pixels of every recorded image."""
    name = bag.own('camera/image_raw')
    codec = Codec(bag.topics[name].definition)
    for message in bag.messages([name]):
        try:
            yield codec.read(message.data)
        except ValueError as error:
            raise ConfigError(f'{bag.path}: {error}') from None


def recompute_motion(
    bag: Bag, lines: list[Heeded], inputs: list[Blocks]
) -> tuple[list[np.void], list[np.void], list[np.void]]:
    """Return rows of `slips`, `felt_slips` and `cascades`, recomputed from `inputs` and taps.

    inputs: blocks of the bag; lines: its requests, from `heeded`; taps are read from the bag.
    """
    from eol_ros.core.motion.motion import Motion

    live = _Live(bag, lines, 'motion')
    motion = Motion(live.settings, recorded_table(bag))
    waiting = _taps(bag)
    new, over, told = [], [], []
    for image in inputs:
        while waiting and waiting[0].stamp_ns <= image.stamp_ns:
            told += [felt.of(one) for one in motion.tap(waiting.pop(0))]
        if live.at(image.stamp_ns):
            motion.set(live.settings)
        rows = image.rows
        begun, closed = motion.update(
            image.stamp_s, rows['x'], rows['y'], image.known, rows['sigma']
        )
        new += [slips.of(image.stamp_ns, slip) for slip in begun]
        told += [felt.of(one, image.stamp_ns) for one in motion.felt_slips()]
        over += [cascades.of(image.stamp_ns, cascade) for cascade in closed]
    told += [felt.of(one) for knock in waiting for one in motion.tap(knock)]
    return new, told, over


def _compare_motion(
    bag: Bag,
    lines: list[Heeded],
    inputs: list[Blocks],
    result: Retracked,
    until_ns: int,
) -> None:
    if not any(bag.name(topic) in bag.topics for topic in ('slips', 'cascades')):
        return
    new, told, over = recompute_motion(bag, lines, inputs)
    _compare(bag, 'slips', slips.RECORD.rows(new), result, until_ns)
    if bag.name('felt_slips') in bag.topics:
        last_ns = inputs[-1].stamp_ns
        _compare(bag, 'felt_slips', felt.RECORD.rows(told), result, until_ns, last_ns)
    _compare(bag, 'cascades', cascades.RECORD.rows(over), result, until_ns)


def _compare_triggers(
    bag: Bag,
    lines: list[Heeded],
    inputs: list[Blocks],
    result: Retracked,
    whole_ns: int,
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
    until_ns = min(int(other['stamp'][0].astype('i8')) if len(other) else 2**63 - 1, whole_ns)
    selector = Selector(live.settings, table=recorded_table(bag))
    selector.load(corpus)
    made: list = []
    knocks = _felt(bag)
    by_knock: list = []

    def knock(until_ns: int) -> None:
        while knocks and knocks[0].stamp <= until_ns:
            k = knocks.pop(0)
            found = selector.felt(k.stamp * 1e-9, k.block, k.x, k.y, k.strength)
            by_knock.extend(triggers.of_knock(k.stamp, 0, trigger) for trigger in found)

    for image in inputs:
        if image.stamp_ns >= until_ns:
            result.notes.append(
                f'grain triggers compared up to number {len(made)} of '
                f'{bag.count("grain_triggers")}: then the run went over to another corpus'
            )
            break
        if live.at(image.stamp_ns):
            selector.settings = live.settings
        knock(image.stamp_ns)
        rows = image.rows
        found = selector.update(image.stamp_s, rows['x'], rows['y'], image.known, rows['sigma'])
        for trigger in found:
            made.append(triggers.of(image.stamp_ns, len(made), trigger))
    _compare(bag, 'grain_triggers', triggers.RECORD.rows(made), result, until_ns)
    if bag.name('felt_triggers') in bag.topics:
        knock(until_ns)
        last_ns = inputs[-1].stamp_ns
        _compare(bag, 'felt_triggers', triggers.RECORD.rows(by_knock), result, until_ns, last_ns)


def _felt(bag: Bag) -> list[Any]:
    """Return the recorded provisional slips, in order of stamps."""
    if bag.name('felt_slips') not in bag.topics:
        return []
    rows = felt.RECORD.each(bag.table('felt_slips'))
    return sorted(row for row in rows if row.kind == felt.PROVISIONAL)


KEYS = {  # columns that identify a message of a topic
    'slips': ('slip', 'kind'),
    'cascades': ('cascade',),
    'grain_triggers': ('sequence',),
    'felt_slips': ('kind', 'block', 'onset'),
    'felt_triggers': ('grain', 'block', 'stamp'),
}
ARRIVED = ('felt_slips', 'felt_triggers')  # their order is that of arrival
INPUT = {  # of a topic, apart from the blocks, whose images are numbered
    'slips': 'block_taps',
    'cascades': 'block_taps',
    'felt_slips': 'block_taps',
    'felt_triggers': 'felt_slips',
}


def _compare(
    bag: Bag,
    topic: str,
    mine: np.ndarray,
    result: Retracked,
    until_ns: int,
    last_ns: int = 2**63 - 1,
) -> None:
    """Compare recomputed rows with the recorded messages.

    Of the messages only those of stamps before `until_ns` count, and none that no block caused.
    What knocks after the last image, of `last_ns`, came to, the run may have ended before.
    """
    table = bag.table(topic)
    if topic == 'grain_triggers':
        table = table[table['block'] != triggers.NO_BLOCK]
        mine = mine[mine['block'] != triggers.NO_BLOCK]
    recorded = len(table)
    table = table[table['stamp'].astype('i8') < until_ns]
    names = KEYS[topic]
    if topic in ARRIVED:
        stamps, known = mine['stamp'].astype('i8'), set(_keys(table, names))
        late = np.array([key in known for key in _keys(mine, names)], bool)
        mine = mine[np.where(stamps > last_ns, late, stamps < until_ns)]
        mine = mine[np.lexsort([mine[name] for name in names])]
        table = table[np.lexsort([table[name] for name in names])]
        columns = [name for name in mine.dtype.names or () if name != 'sequence']
        mine = mine[columns]  # it counts arrivals
    if (lost := len(mine) - len(table)) > 0 and lost <= _losses(bag, topic):
        there = set(_keys(table, names))
        mine = mine[np.array([key in there for key in _keys(mine, names)], bool)]
    check = Comparison(topic, recorded, len(mine), proved=len(table))
    if topic in INPUT and (count := _losses(bag, INPUT[topic])):
        check.lost_input = f'{count} of {INPUT[topic]}'
    both = min(len(table), len(mine))
    check.compare(mine[:both], table[:both], lambda row: f'number {row}')
    result.topics[topic] = check


def _keys(rows: np.ndarray, names: tuple[str, ...]) -> Iterator[tuple[Any, ...]]:
    return zip(*(rows[name].tolist() for name in names), strict=True)


def _unequal(mine: np.ndarray, theirs: np.ndarray) -> Iterator[tuple[str, np.ndarray, float]]:
    """Yield name, mask of unequal rows (n,) and distance to `theirs` of each column of `mine`.

    Values are compared bit for bit; NaN equals NaN. The distance is the largest difference as a
    share of the column's largest value, infinite if anything but a float differs. Records are
    compared field by field.
    """
    for name in mine.dtype.names or ():
        a, b = mine[name], np.asarray(theirs[name])
        if a.dtype.names:
            yield from _unequal(a, b)
        elif a.dtype == object:
            pairs = zip(a, b, strict=True)
            where = np.array([not np.array_equal(x, y) for x, y in pairs], bool)
            yield name, where, np.inf if where.any() else 0.0
        else:
            a = a.astype(b.dtype, copy=False)
            where = a != b
            apart = np.inf if where.any() else 0.0
            if a.dtype.kind == 'f':
                where &= ~(np.isnan(a) & np.isnan(b))
                apart = _apart(a, b, where)
            yield name, where.any(axis=tuple(range(1, where.ndim))), apart


def _apart(a: np.ndarray, b: np.ndarray, where: np.ndarray) -> float:
    """Return the largest |a - b| at `where` over the largest |b|, or infinity."""
    if not where.any():
        return 0.0
    a, scale = a.astype('f8'), np.abs(b[np.isfinite(b)].astype('f8')).max(initial=0.0)
    apart = float(np.abs(a[where] - b[where]).max())
    return apart / scale if np.isfinite(apart) and scale else np.inf
