# SPDX-License-Identifier: Apache-2.0
"""New bags from others: a time range of a bag, the readable part of a damaged one."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path

from eol_ros.devices.bag.mcap_file import BagFile, BagTopic
from eol_ros.devices.bag.reader import BagMessage, BagReader
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
