# SPDX-License-Identifier: Apache-2.0
"""A bag: a rosbag2 folder of MCAP files, split by time and size, with `metadata.yaml` version 9.

A file in the making is called `*.mcap.part` and locked (flock); it gets its name when it is whole.
So a name that ends in `.mcap` means a file with index and end, and a `.part` without a lock is what
a killed writer left behind (see `recover`).
"""

import fcntl
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import yaml

from eol_ros.devices.bag.mcap_file import BagFile, BagTopic
from eol_ros.devices.files.names import shown
from eol_ros.disk import DISK, Disk
from eol_ros.errors import ConfigError

PART = '.part'
RUN_METADATA = 'eol_ros'  # of the MCAP metadata records that this project writes
GAPS_METADATA = 'eol_ros.gaps'
REPLAY_OF = 'replay_of'  # in RUN_METADATA: this run was itself a replay, of that bag
CONTINUES = 'continues'  # the same: the bag of the run before the system clock was set
SAMPLE = 'sample'  # the same: the recording that ships, not one of this machine


@dataclass(frozen=True)
class FileSummary:
    """What `metadata.yaml` says of one file: times in ns since the epoch, messages per topic."""

    name: str
    start_ns: int
    end_ns: int
    counts: Mapping[str, int]

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return sum(self.counts.values())


def metadata_text(
    topics: Collection[BagTopic], files: Sequence[FileSummary], custom: Mapping[str, str]
) -> str:
    """Return the text of `metadata.yaml`, rosbag2_bagfile_information version 9."""
    filled = [f for f in files if f.message_count]
    start = min((f.start_ns for f in filled), default=0)
    end = max((f.end_ns for f in filled), default=0)
    information = {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': end - start},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(f.message_count for f in files),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': topic.encoding,
                    'offered_qos_profiles': yaml.safe_load(topic.qos) if topic.qos else [],
                    'type_description_hash': topic.type_hash,
                },
                'message_count': sum(f.counts.get(topic.key, 0) for f in files),
            }
            for topic in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [f.name for f in files],
        'files': [
            {
                'path': f.name,
                'starting_time': {'nanoseconds_since_epoch': f.start_ns},
                'duration': {'nanoseconds': f.end_ns - f.start_ns},
                'message_count': f.message_count,
            }
            for f in files
        ],
        'custom_data': {key: shown(text) for key, text in custom.items()} or None,
        'ros_distro': 'jazzy',
    }
    return yaml.safe_dump(
        {'rosbag2_bagfile_information': information}, sort_keys=False, allow_unicode=True, width=100
    )


class BagExists(ConfigError):
    """A new bag was to have the name of something that is there."""


def make_folder(folder: Path) -> None:
    """Make a new bag folder; raise ConfigError in words when it cannot be."""
    where, probe = folder.parent, folder / ('probe' + PART)
    try:
        where.mkdir(parents=True, exist_ok=True)
        folder.mkdir()
        where = folder
        probe.touch()
        probe.unlink()
    except OSError as error:
        if isinstance(error, FileExistsError) and Path(error.filename) == folder:
            raise BagExists(f'bag folder {folder} is there already') from None
        text = f'bag folder {where} cannot be written: {error.strerror}'
        raise ConfigError(text) from None


class BagWriter:
    """Writes a bag folder, for one thread; `write` and the rest may raise OSError."""

    def __init__(
        self,
        folder: Path,
        topics: Collection[BagTopic],
        about: Mapping[str, str],
        split_s: float = 3600.0,
        split_bytes: int = 4 << 30,
        disk: Disk = DISK,
    ):
        self.folder = folder
        self._disk = disk
        self.gaps: dict[str, str] = {}  # written into the metadata whenever a file is closed
        self.files: list[FileSummary] = []
        self._topics = tuple(topics)
        self._channel = {topic.key: i for i, topic in enumerate(self._topics, 1)}
        self._about = dict(about)
        self._split_ns = round(split_s * 1e9)
        self._split_bytes = split_bytes
        self._file: BagFile | None = None
        make_folder(folder)
        disk.sync_folder(folder.parent)
        self._open()

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        current = self._file.message_count if self._file else 0
        return sum(f.message_count for f in self.files) + current

    def write(
        self,
        topic: str,
        data: bytes,
        log_ns: int,
        publish_ns: int,
        sequence: int = 0,
        hurry: bool = False,
    ) -> None:
        """Add one serialised message, stamped with reception and sending time in ns."""
        file = self._file
        assert file is not None, 'write after close'
        if file.message_count and (
            log_ns - file.start_ns >= self._split_ns or file.size_bytes >= self._split_bytes
        ):
            self._close_file()
            file = self._open()
        file.write(self._channel[topic], data, log_ns, publish_ns, sequence, hurry)

    def flush(self) -> None:
        """Hand what was written to the operating system: it outlives this process now."""
        if self._file:
            self._file.flush()

    def sync(self) -> None:
        """Return when what was written survives a power cut."""
        if self._file:
            self._file.sync()

    def second_handle(self) -> BinaryIO | None:
        """Flush, and return a second handle of the unfinished file; None if there is none."""
        return self._file.second_handle() if self._file else None

    def close(self) -> None:
        """Finish the file in the making and write the last `metadata.yaml`."""
        if self._file:
            self._close_file()

    def abandon(self) -> None:
        """Leave the unfinished file as `.part`, to be recovered when there is room again."""
        if self._file:
            self._file.abandon()
            self._file = None

    def _open(self) -> BagFile:
        name = f'{self.folder.name}_{len(self.files)}.mcap'
        self._file = BagFile(self.folder / (name + PART), self._topics, disk=self._disk)
        fcntl.flock(self._file.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._file.add_metadata(RUN_METADATA, self._about)
        self._file.sync()
        self._disk.sync_folder(self.folder)
        return self._file

    def _close_file(self) -> None:
        file = self._file
        assert file is not None
        name = file.path.name.removesuffix(PART)
        file.add_metadata(GAPS_METADATA, self.gaps)
        counts = dict(zip(self._channel, file.counts.values(), strict=True))
        summary = FileSummary(name, file.start_ns, file.end_ns, counts)
        text = metadata_text(self._topics, [*self.files, summary], self._about | self.gaps)
        file.add_metadata('rosbag2', {'serialized_metadata': text})
        file.close()
        self._disk.rename(file.path, self.folder / name)
        self._file = None
        self.files.append(summary)
        self._disk.write(self.folder / 'metadata.yaml', text)
