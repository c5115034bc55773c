# SPDX-License-Identifier: Apache-2.0
"""What is removed when there is too much, and what never is; a year of it."""

import json
import os
import random
import time
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from support.bag_samples import POINT, T0, TEXT, point, text

from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.retention import DAY_S, KEPT, Folder, Limits, Stored, enforce, mark
from eol_ros.devices.bag.verify import verify
from eol_ros.devices.bag.writer import BagWriter

GB = 10**9
MIN_FREE = 2 * GB
LIMITS = Limits(days=90, size=200 * GB, free=MIN_FREE + 5 * GB)


@dataclass
class Kept:
    """One recording of the year: bytes of its messages and of its images."""

    messages: int
    pictures: int
    changed_s: float
    bag: bool = True
    marked: bool = False
    writing: bool = False


class Year:
    """A disk and a clock that stand in for a museum's: a Store of sizes and times."""

    def __init__(self, disk: int):
        self.disk = disk
        self.kept: dict[Path, Kept] = {}

    def stored(self):
        return [
            Stored(p, k.messages + k.pictures, k.changed_s, k.bag, k.marked or k.writing)
            for p, k in self.kept.items()
        ]

    def free(self):
        return self.disk - sum(k.messages + k.pictures for k in self.kept.values())

    def has_pictures(self, stored):
        return self.kept[stored.path].pictures > 0

    def remove_pictures(self, stored):
        assert not self.kept[stored.path].marked and not self.kept[stored.path].writing
        self.kept[stored.path].pictures = 0

    def remove(self, stored):
        assert not self.kept[stored.path].marked and not self.kept[stored.path].writing
        del self.kept[stored.path]


@pytest.mark.slow
@pytest.mark.parametrize('disk_gb', [128, 256])
def test_a_year_is_never_full_and_never_without_the_last_thirty_days(disk_gb):
    """Open ten hours a day, blocks always moving, 20 GB of images; a power cut now and then."""
    rng, year = random.Random(disk_gb), Year(disk_gb * GB)
    now = datetime(2026, 1, 1, 10)
    bags: list[tuple[datetime, Path]] = []
    said: list[str] = []
    for day in range(365):
        runs = rng.choice([1, 1, 1, 3])
        for run in range(runs):
            path = Path(f'museum_{day}_{run}')
            bags.append((now, path))
            year.kept[path] = Kept(0, 0, 0, marked=rng.random() < 0.005, writing=True)
            for _hour in range(10 // runs):
                now += timedelta(hours=1)
                bag = year.kept[path]
                bag.messages += 170 * GB // 1000
                bag.pictures += 2 * GB
                bag.changed_s = now.timestamp()
                assert year.free() > MIN_FREE, now
                said += enforce(year, LIMITS, now.timestamp())  # in truth, once a minute
            year.kept[path].writing = False
        if day % 7 == 0:
            name = Path(f'sound-{day}.wav')
            year.kept[name] = Kept(2 * GB, 0, now.timestamp(), bag=False)
        said += enforce(year, LIMITS, now.timestamp())
        month = [p for when, p in bags if now - when < timedelta(days=30)]
        assert all(p in year.kept for p in month)
        assert year.free() >= LIMITS.free
        assert (
            now.timestamp() - min(k.changed_s for k in year.kept.values() if not k.marked)
            <= 91 * DAY_S
        )
        assert sum(s.size for s in year.stored()) <= LIMITS.size
        now = now.replace(hour=10, minute=0) + timedelta(days=1)
    marked = [p for p, k in year.kept.items() if k.marked]
    assert marked and any('raw images' in line for line in said)
    assert sum(k.pictures > 0 for k in year.kept.values()) >= 1  # the newest still have them


def test_a_clock_that_is_wrong_by_decades_removes_nothing_of_the_last_days():
    year = Year(256 * GB)
    now_s = time.mktime((2026, 6, 1, 12, 0, 0, 0, 0, -1))
    for day in range(60):
        year.kept[Path(f'run_{day}')] = Kept(GB, 0, now_s - (59 - day) * DAY_S)
    list(enforce(year, LIMITS, now_s + 30 * 365 * DAY_S))
    assert sorted(year.kept) == sorted(Path(f'run_{day}') for day in range(30, 60))
    list(enforce(year, LIMITS, 0.0))  # 1970
    assert len(year.kept) == 30


def test_pictures_go_before_bags_and_the_oldest_first():
    year = Year(1000 * GB)
    for day in range(40):
        year.kept[Path(f'run_{day}')] = Kept(GB, 9 * GB, day * DAY_S + 1e9)
    lines = list(enforce(year, replace(LIMITS, days=0), 1e9 + 40 * DAY_S))
    assert len(year.kept) == 40
    assert [k.pictures > 0 for k in year.kept.values()] == [False] * 23 + [True] * 17
    assert lines[0] == 'run_0: raw images removed, for want of room'
    list(enforce(year, replace(LIMITS, days=0, size=33 * GB), 1e9 + 40 * DAY_S))
    assert sorted(int(p.name[4:]) for p in year.kept) == list(range(7, 40))
    list(enforce(year, replace(LIMITS, days=0, size=3 * GB), 1e9 + 40 * DAY_S))
    assert len(year.kept) == 30  # no fewer, even so


def make(root: Path, name: str, days_ago: float = 0.0) -> Path:
    """Record 20 points and 20 images into `name`, `days_ago`."""
    bag = BagWriter(root / name, [POINT, TEXT], {'scene': name})
    for i in range(20):
        bag.write('/eol/point', point(i), T0 + i * 10**9, T0, i + 1)
        bag.write('/eol/text', text('x' * 70_000), T0 + i * 10**9 + 1, T0, i + 1)
    bag.gaps = {'lost_before_recorder': '{}'}
    bag.close()
    then = time.time() - days_ago * DAY_S
    for path in (root / name).glob('*.mcap'):
        os.utime(path, (then, then))
    return root / name


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))
    (tmp_path / 'bags').mkdir()
    return tmp_path / 'bags'


def test_pictures_of_a_real_bag_are_removed_and_nothing_else(root):
    folder = make(root, 'old', 5)
    store = Folder(root, '/eol/text')
    [stored] = store.stored()
    assert store.has_pictures(stored)
    before = BagReader(folder)
    points = list(before.messages(['/eol/point']))
    store.remove_pictures(stored)
    after = BagReader(folder)
    assert list(after.messages()) == points
    assert (after.about, after.topics) == (before.about, before.topics)
    assert after.gaps == before.gaps | {'pictures_removed': '20'}
    assert verify(folder)[1] == []
    [thinner] = store.stored()
    assert thinner.size < stored.size and thinner.changed_s == pytest.approx(stored.changed_s)
    assert not store.has_pictures(thinner)


def test_a_damaged_bag_is_not_copied(root):
    folder = make(root, 'old', 5)
    [path] = folder.glob('*.mcap')
    data = bytearray(path.read_bytes())
    place = next(p for p in BagReader(path).files[0].places if 1 in p.channels)
    data[place.end - 10] ^= 1  # in its data
    path.write_bytes(data)
    store = Folder(root, '/eol/text')
    [stored] = store.stored()
    with pytest.warns(UserWarning, match='may be missing'), pytest.raises(OSError, match='damaged'):
        store.remove_pictures(stored)
    assert path.read_bytes() == data
    assert [p.name for p in folder.iterdir() if p.name.endswith('.thin')] == []


def test_only_what_the_recorder_made_is_removed(root):
    make(root, 'plain', 100)
    make(root, 'marked', 100)
    make(root, 'noted', 100)
    make(root, 'new')
    mark(root / 'marked', True)
    (root / 'noted' / 'notes.txt').write_text('mine')
    (root / 'folder').mkdir()
    (root / 'photo.jpg').write_bytes(b'mine')
    writing = BagWriter(root / 'writing', [POINT], {})
    limits = replace(LIMITS, free=0.0)
    lines = list(enforce(Folder(root, '/eol/text'), replace(limits, days=1), time.time()))
    assert sorted(lines) == [f'{n}: removed: older than 1 days' for n in ('noted', 'plain')]
    left = sorted(p.relative_to(root).as_posix() for p in root.rglob('*') if p.is_file())
    assert left == sorted([
        'marked/kept.txt', 'marked/marked_0.mcap', 'marked/metadata.yaml', 'new/metadata.yaml',
        'new/new_0.mcap', 'noted/notes.txt', 'photo.jpg', 'writing/writing_0.mcap.part',
    ])  # fmt: skip
    writing.close()


def test_pictures_of_another_namespace_are_pictures(root):
    bag = BagWriter(root / 'north', [
        replace(POINT, name='/north/camera/image_raw', type='sensor_msgs/msg/Image'),
        replace(TEXT, name='/north/blocks', type='eol_msgs/msg/Blocks'),
    ], {})  # fmt: skip
    for i in range(3):
        bag.write('/north/camera/image_raw', point(i), T0 + i, T0, i)
        bag.write('/north/blocks', text('x'), T0 + i, T0, i)
    bag.close()
    store = Folder(root, '/eol/camera/image_raw')
    [stored] = store.stored()
    assert store.has_pictures(stored)
    store.remove_pictures(stored)
    left = BagReader(root / 'north')
    assert (left.count('camera/image_raw'), left.count('blocks')) == (0, 3)


def test_sound_files_and_logs_share_the_room(root):
    then = time.time() - 50 * DAY_S
    state = Path(os.environ['EOL_STATE'])
    state.mkdir()
    # bringup holds the last two open, however long nothing happens or wherever the clock is set
    for path in (
        root / 'sound-20260101-100000.wav', state / 'eol.log.3', state / 'eol.log',
        state / 'events.log',
    ):  # fmt: skip
        path.write_bytes(bytes(1000))
        os.utime(path, (then, then))
    make(root, 'new')
    lines = list(enforce(Folder(root, '/eol/text'), Limits(0, 1500, 0), time.time()))
    assert not (root / 'sound-20260101-100000.wav').exists()
    assert sorted(p.name for p in state.iterdir()) == ['eol.log', 'events.log']
    assert BagReader(root / 'new').counts['/eol/point'] == 20
    assert lines[0] == 'new: raw images removed, for want of room'


def test_the_sample_that_ships_is_marked():
    assert (Path(__file__).parents[2] / 'bags' / 'sample' / KEPT).exists()
    gaps = BagReader(Path(__file__).parents[2] / 'bags' / 'sample').gaps
    assert json.loads(gaps['received'])
