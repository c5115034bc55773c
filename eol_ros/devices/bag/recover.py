# SPDX-License-Identifier: Apache-2.0
"""Makes whole again what a killed or unplugged recorder left: `*.mcap.part` becomes `*.mcap`.

The records are read from the start up to where the file ends, and written anew with index and end.
What was flushed is there; the last second may be missing.
"""

import fcntl
import os
from dataclasses import dataclass
from pathlib import Path

from eol_ros.devices.bag.mcap_file import BagFile
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.writer import (
    GAPS_METADATA,
    PART,
    RUN_METADATA,
    FileSummary,
    metadata_text,
    replace_text,
)
from eol_ros.errors import ConfigError

REPAIR = '.repair'  # a repair that was itself cut off; done again from the start


@dataclass(frozen=True)
class Repaired:
    """What became of one left-over file; `file` is None when nothing in it could be read."""

    part: Path
    file: Path | None
    message_count: int


def leftovers(root: Path) -> list[Path]:
    """Return the `.part` files in `root` and in its bag folders that nobody writes any more."""
    found = sorted([*root.glob(f'*.mcap{PART}'), *root.glob(f'*/*.mcap{PART}')])
    return [path for path in found if not _in_use(path)]


def repair(part: Path) -> Repaired:
    """Rewrite `part` as a whole file and bring `metadata.yaml` up to date; may raise OSError.

    A part without a single readable message is removed, and its folder if nothing else is in it.
    """
    target = part.with_name(part.name.removesuffix(PART))
    if target.exists():  # a repair that was cut off before its last step
        part.unlink()
        rewrite_metadata(part.parent)
        return Repaired(part, target, sum(BagReader(target).counts.values()))
    try:
        bag = BagReader(part)
        count = sum(bag.counts.values())
    except ConfigError:  # not even the first bytes were written
        count = 0
    if not count:
        part.unlink()
        if not any(part.parent.iterdir()):
            part.parent.rmdir()
        return Repaired(part, None, 0)
    scratch = part.with_name(target.name + REPAIR)
    scratch.unlink(missing_ok=True)
    topics = list(bag.topics.values())
    channel = {topic.name: i for i, topic in enumerate(topics, 1)}
    out = BagFile(scratch, topics)
    out.add_metadata(RUN_METADATA, bag.about)
    out.add_metadata(GAPS_METADATA, bag.gaps | {'recovered': f'from {part.name}'})
    for m in bag.messages():
        out.write(channel[m.topic], m.data, m.log_ns, m.publish_ns, m.sequence)
    out.close()
    os.replace(scratch, target)
    part.unlink()
    rewrite_metadata(part.parent)
    return Repaired(part, target, count)


def repair_all(root: Path) -> list[Repaired]:
    """Repair every left-over file under `root`; may raise OSError."""
    return [repair(part) for part in leftovers(root)] if root.is_dir() else []


def rewrite_metadata(folder: Path) -> None:
    """Write `metadata.yaml` of a bag folder anew from its whole files."""
    bags = [BagReader(p) for p in sorted(folder.glob('*.mcap'))]
    topics, custom, files = {}, {}, []
    for bag in sorted(bags, key=lambda b: b.start_ns):
        topics.update(bag.topics)
        custom.update(bag.about | bag.gaps)
        files.append(FileSummary(bag.path.name, bag.start_ns, bag.end_ns, bag.counts))
    text = metadata_text(list(topics.values()), files, custom)
    replace_text(folder / 'metadata.yaml', text)


def _in_use(part: Path) -> bool:
    with open(part, 'rb') as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
