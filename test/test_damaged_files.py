# SPDX-License-Identifier: Apache-2.0
"""What a power cut leaves of any file that is read at a start: empty, cut, or filled with zeros.

The files are found by listing the folders after everything has been written once.
"""

import shutil
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.bag_samples import T0, write_bag

from eol_ros import compiled, disk
from eol_ros import scene as scenes
from eol_ros.analysis import exhibition
from eol_ros.bringup.memory import Memory
from eol_ros.core.table import Table
from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.devices.audio import audio_file
from eol_ros.devices.audio.bank import load_bank
from eol_ros.devices.bag import retention
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recording import ImageBudget
from eol_ros.devices.corpus import corpus_build, corpus_file
from eol_ros.devices.files import background_file
from eol_ros.devices.files.day_file import DayFile
from eol_ros.devices.files.media_folder import MediaFolder
from eol_ros.devices.files.tracker_files import TrackerFiles
from eol_ros.errors import EolError
from eol_ros.ros import network, presets
from eol_ros.settings import TrackerSettings

DAMAGE = {
    'empty': lambda data: b'',
    'half': lambda data: data[: len(data) // 2],
    'zeros': lambda data: bytes(len(data)),
}
OPTIONS = corpus_file.Options(grain_s=0.25, segment='labels', more_sounds=())


class Folders:
    """Everything that a run reads when it starts, in folders below `root`."""

    def __init__(self, root, monkeypatch):
        self.root, self.dark = root, root / 'state' / 'dark.png'
        for name in ('state', 'cache', 'numba', 'media', 'corpus', 'bags'):
            (root / name).mkdir(exist_ok=True)
        monkeypatch.setenv('EOL_STATE', str(root / 'state'))
        monkeypatch.setenv('EOL_CACHE', str(root / 'cache'))
        monkeypatch.setenv('NUMBA_CACHE_DIR', str(root / 'numba'))
        self.scene = scenes.Scene.alone('sound', 'grains')

    def write(self):
        """Write them all as the program does."""
        DayFile('museum').save({'areas': [1, 2]}, 0.0)
        memory = Memory(self.scene, 0)
        memory.note({'sound': {'muted': True}})
        memory.end(asked=False)
        presets.save(presets.folder() / 'calm.yaml', {'grains': {'radius': 0.1}})
        background_file.save(self.dark, BackgroundModel(np.zeros((40, 60), np.uint8)))
        compiled.store('x.object', {}, b'machine code')
        compiled.stamp('tracker')
        rng = np.random.default_rng(1)
        for name in 'ab':
            sound = self.root / 'corpus' / f'{name}.wav'
            audio_file.write(sound, rng.uniform(-0.3, 0.3, 16000).astype('f4'), 16000)
            corpus_file.beside(sound, 'labels.txt').write_text('0.1\t0.4\tcrack\n0.5\t0.9\tgroan\n')
            corpus_file.beside(sound, 'moved.csv').write_text('time_s,x,y\n0.2,0.5,0.5\n')
        for name in ('a.jpg', 'b.png', 'c.webp', 'd.png'):
            noise = rng.integers(0, 255, (60, 80, 3)).astype(np.uint8)
            cv2.imwrite(str(self.root / 'media' / name), noise)
        (self.root / 'media' / 'pairs.csv').write_text('left,right\na.jpg,b.png\nc.webp,d.png\n')
        for name in ('monday', 'tuesday'):
            write_bag(self.root / 'bags' / name, count=200).close()
            retention.mark(self.root / 'bags' / name, True)
        budget = self.budget()
        budget.take(7)
        budget.keep()
        self.start()  # fills the caches

    def budget(self):
        return ImageBudget(self.root / 'bags', 1.0, lambda: '2026-11-27')

    def start(self):
        """Read them all as a start does; return what came of it."""
        disk._named.clear()
        found = {
            'day': DayFile('museum').load(),
            'kept': Memory(self.scene, 0).recall(),
            'background': len(
                TrackerFiles(TrackerSettings(background=str(self.dark)), Table()).lamps
            ),
            'presets': [
                _or_error(lambda n=n: presets.load(presets.path_of(n, presets.folder())))
                for n in presets.names(presets.folder())
            ],
            'pictures of today': self.budget().bytes,
            'code': compiled.load('x.object'),
            'cold': compiled.cold(['tracker']),
            'dds': network.environment('local', False, False).keys(),
        }
        compiled.forget()
        corpus = corpus_build.build_cached(
            corpus_file.all_sounds(str(self.root / 'corpus'), OPTIONS), OPTIONS
        )
        grains = corpus.grains
        files = [source.path for source in corpus.sources]
        bank = load_bank(files, grains['file'], grains['start_s'], grains['duration_s'], 16000)
        found |= {'grains': len(corpus), 'notes': corpus.notes, 'bank': len(bank)}
        ice = corpus_build.make_ice()
        found['ice'] = hash(audio_file.read_mono(ice).samples.tobytes())
        media = _or_error(lambda: MediaFolder(self.root / 'media'))
        found['pairs'] = len(media.pairs) if isinstance(media, MediaFolder) else media
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            paths, _ = exhibition.bags_in([self.root / 'bags'])
            digests = [exhibition.digest(path) for path in paths]
            found['bags'] = [d.path for d in digests if not isinstance(d, str)]
            found['newest'] = _or_error(lambda: BagReader(self.root / 'bags').path.name)
        list(retention.enforce(retention.Folder(self.root / 'bags', 'x'),
                               retention.Limits(0, 0, 0), T0 * 1e-9))  # fmt: skip
        return found


def _or_error(make):
    try:
        return make()
    except EolError as error:
        assert '\n' not in str(error)
        return error


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    with pytest.MonkeyPatch.context() as monkeypatch:
        folders = Folders(tmp_path_factory.mktemp('run'), monkeypatch)
        folders.write()
        yield folders, folders.start()


@pytest.mark.parametrize('damage', DAMAGE)
def test_every_file_may_be_damaged_and_the_rest_goes_on(written, damage, capfd):
    folders, whole = written
    root = folders.root
    files = sorted(p.relative_to(root) for p in root.rglob('*') if p.is_file())
    names = {str(Path(*path.parts[:2])) for path in files}
    assert {'state/presets', 'cache/grains', 'cache/ice', 'cache/corpus', 'cache/dds'} <= names
    keep = root.with_name('keep')
    shutil.copytree(root, keep, dirs_exist_ok=True)
    for name in files:
        data = (root / name).read_bytes()
        (root / name).write_bytes(DAMAGE[damage](data))
        capfd.readouterr()
        found, changed = folders.start(), DAMAGE[damage](data) != data
        differs = {key for key, value in whole.items() if str(found[key]) != str(value)}
        area = name.parts[0]
        if area in ('cache', 'numba'):  # made again, but for machine code, which a compiler makes
            assert differs <= {'code', 'cold'}, name
        if area in ('corpus', 'media', 'bags'):  # one of two is left out
            assert found['grains'] >= 2 and found['bank'] >= 2, name
            assert found['bags'] and (found['pairs'] == 2 or differs), name
        if name.name in ('cascades-museum.json', 'x.object') and changed:
            assert name.name in capfd.readouterr().err
        shutil.rmtree(root)
        shutil.copytree(keep, root)
    assert folders.start() == whole or str(folders.start()) == str(whole)
