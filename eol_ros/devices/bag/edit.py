# SPDX-License-Identifier: Apache-2.0
"""Bags out of bags: a stretch of one, several as one, what can be read of a damaged one."""

import contextlib
import heapq
import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path

from eol_ros.devices.bag.file import add_topic
from eol_ros.devices.bag.mcap_file import BagFile, BagTopic
from eol_ros.devices.bag.reader import BagMessage, BagReader, table_in
from eol_ros.devices.bag.writer import GAPS_METADATA, RUN_METADATA, BagWriter
from eol_ros.errors import ConfigError

FROM = 'from'  # in RUN_METADATA: the bags that it was made of
DAMAGED = 'damaged'  # in GAPS_METADATA: what of them could not be read


def copy(
    out: Path,
    topics: Collection[BagTopic],
    messages: Iterator[BagMessage],
    about: Mapping[str, str],
    gaps: dict[str, str],
    damage: Callable[[], list[str]],
) -> int:
    """Write `messages` to `out`, a new bag folder, or a file if it ends in .mcap; count them.

    `damage` says what could not be read, when all has been. Raises ConfigError where `out` is there
    or cannot be written, and OSError.
    """
    if out.exists():
        raise ConfigError(f'{out}: is there already; choose another --output')

    if out.suffix == '.mcap':
        if not out.absolute().parent.is_dir():
            raise ConfigError(f'{out}: there is no such folder')
        return write_file(
            out, topics, messages, {RUN_METADATA: about}, lambda: noted(gaps, damage())
        )
    bag = BagWriter(out, topics, about)
    for m in messages:
        bag.write(*m)
    bag.gaps = noted(gaps, damage())
    bag.close()
    return bag.message_count


def noted(gaps: dict[str, str], damage: Sequence[str]) -> dict[str, str]:
    """Return `gaps` with a note of the damage."""
    return gaps | ({DAMAGED: json.dumps(damage)} if damage else {})


def write_file(
    out: Path,
    topics: Collection[BagTopic],
    messages: Iterator[BagMessage],
    metadata: Mapping[str, Mapping[str, str]],
    gaps: Callable[[], Mapping[str, str]],
) -> int:
    """Write `messages` to a new file; `gaps` is called when all are written. Count them."""
    file = BagFile(out, topics)
    channel = {topic.key: number for number, topic in enumerate(topics, 1)}
    try:
        for name, texts in metadata.items():
            file.add_metadata(name, texts)
        for m in messages:
            file.write(channel[m.topic], *m[1:])
        file.add_metadata(GAPS_METADATA, gaps())
        file.close()
    except BaseException:
        file.abandon()
        raise
    return file.message_count


def stretch(
    bag: BagReader, names: Collection[str] | None, start_ns: int, end_ns: int | None
) -> Iterator[BagMessage]:
    """Yield the messages of topics `names` (None: all) from start_ns up to end_ns.

    What was told before on latched topics holds in the stretch, too: the last of each is yielded
    first, as received at its start.
    """
    for message in bag.latched(names, start_ns):
        yield message._replace(log_ns=start_ns)
    yield from bag.messages(names, start_ns, end_ns)


def merged(bags: Sequence[BagReader]) -> tuple[list[BagTopic], Iterator[BagMessage]]:
    """Return the topics of all bags, and their messages in order of reception.

    A further definition of a type is a topic of its own, as it is in one bag. Raises ConfigError
    where bags have other types on one topic, or are of different tables.
    """
    from eol_ros.core.table import check_same  # NumPy, which others of this module need not

    tables = [(bag, table) for bag in bags if (table := table_in(bag.about.get('settings', '')))]
    for bag, table in tables:
        advice = 'merge the bags of each table apart'
        check_same(table, tables[0][1], str(bag.path), str(tables[0][0].path), advice)
    topics: dict[str, BagTopic] = {}
    keys = []
    for bag in bags:
        known: dict[str, set[str]] = {}
        for topic in topics.values():
            known.setdefault(topic.name, set()).add(topic.type)
        for topic in bag.topics.values():
            if topic.type not in (types := known.get(topic.name, {topic.type})):
                raise ConfigError(
                    f'{bag.path}: {topic.name} is {topic.type}, and {", ".join(sorted(types))} in '
                    'the bags before it: they cannot be one bag'
                )
        keys.append({key: add_topic(topics, topic) for key, topic in bag.topics.items()})
    streams = (map(_renamed(own), bag.messages()) for own, bag in zip(keys, bags, strict=True))
    return list(topics.values()), heapq.merge(*streams, key=lambda m: m.log_ns)


def _renamed(keys: Mapping[str, str]) -> Callable[[BagMessage], BagMessage]:
    return lambda message: message._replace(topic=keys[message.topic])


def merged_gaps(bags: Sequence[BagReader]) -> dict[str, str]:
    """Return what was lost of all bags together: counts are added up."""
    total: dict[str, Counter] = {}
    for name, text in (item for bag in bags for item in bag.gaps.items()):
        with contextlib.suppress(ValueError):
            if isinstance(counts := json.loads(text), dict):
                total.setdefault(name, Counter()).update(counts)
    return {name: json.dumps(counts, sort_keys=True) for name, counts in total.items()}
