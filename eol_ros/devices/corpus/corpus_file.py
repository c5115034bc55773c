# SPDX-License-Identifier: Apache-2.0
"""The corpus on disk: JSON, CSV, Audacity labels, hand-moved grains, and the cache by content.

Light on purpose: no scipy, no libsndfile. Whoever only plays a corpus made before needs
nothing else; `corpus_build` makes one.
"""

import csv
import hashlib
import io
import json
import math
import os
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from eol_ros import folders
from eol_ros.core.sound.corpus import AXES, COLUMNS, GRAIN, Corpus, Source
from eol_ros.devices.files import text_table
from eol_ros.devices.files.names import find, visible
from eol_ros.disk import DISK, check_file, content, read
from eol_ros.errors import ConfigError, DeviceMissing, EolError, nearest, writing
from eol_ros.said import said
from eol_ros.settings import DESCRIPTORS, GrainsSettings

VERSION = 1  # of the JSON
ICE = 'ice-2-1.wav'  # by which bags know it
ANALYSIS = 3  # increased whenever the same sound gives other grains or descriptors
SOUNDS = {'.wav', '.flac', '.ogg', '.oga', '.opus', '.aif', '.aiff', '.mp3', '.caf', '.au', '.w64'}
LEFT_OUT = 'left out: '  # with which a note on a sound or its companions begins
MOST_CORPUS = 500_000_000  # bytes of its JSON (chosen): some 700,000 grains
MOST_S = 86400.0  # of a sound: a day
_MADE = 'the .json that `eol corpus SOUND --output` writes'
DIGITS = 9  # significant, in JSON and CSV


@dataclass(frozen=True)
class Options:
    """How a corpus is made: the settings of `grains` of these names, and what `eol corpus` adds."""

    segment: str = 'chop'
    grain_s: float = 0.25
    overlap: float = 0.0
    x_axis: str = 'centroid_mean_hz'
    y_axis: str = 'periodicity_mean'
    layout: str = 'even'
    blend: float = 1.0
    onset_db: float = 4.0
    gate_on_db: float = -40.0
    gate_off_db: float = -50.0
    silence_db: float = -70.0
    labels: str = ''  # label track; empty: the one beside the sound
    # Younger than the digests that are about: they count only where they are not as here.
    more_sounds: tuple[str, ...] = ()
    regions: tuple[str, ...] = ()

    @classmethod
    def of(cls, settings: GrainsSettings) -> 'Options':
        """Return those that the settings of the node name."""
        names = {f.name for f in fields(settings)}
        return cls(**{f.name: getattr(settings, f.name) for f in fields(cls) if f.name in names})


# Settings of `grains` that make another corpus; and the seed, which cannot glide either.
REMAKING = frozenset({'sound', 'seed', *(f.name for f in fields(Options))})


def ice_file() -> Path:
    """Return where the ice recording is kept once unpacked."""
    return folders.cache('ice') / ICE


def all_sounds(sound: str, options: Options) -> list[Path]:
    """Return all sound files of the setting `sound`, empty for ice, and of `more_sounds`.

    What is not there is among them if anything else is: `build` leaves it out and names it. Raises
    as `sounds_of` where nothing is there.
    """
    found: list[Path] = [] if sound else [ice_file()]
    errors: list[EolError] = []
    for each in map(Path, (*([sound] if sound else []), *options.more_sounds)):
        try:
            found += sounds_of(each)
        except DeviceMissing as error:
            errors.append(error)
            found.append(each)
        except ConfigError as error:  # a folder without sounds: it may be filled yet
            errors.append(error)
    if errors and sound and not any(each.is_file() for each in found):
        raise errors[0]
    return found


def _sounds_in(folder: Path) -> list[Path]:
    try:
        return [p for p in visible(folder) if p.suffix.lower() in SOUNDS]
    except OSError:
        return []


def sounds_of(path: Path) -> list[Path]:
    """Return the sound files that `path` means: itself, or those of a folder in natural order."""
    path = find(path.parent, path.name)
    if path.is_dir():
        found = _sounds_in(path)
        if not found:
            raise ConfigError(
                f'{path}: no sound file in this folder; put WAV, FLAC or OGG files there'
            )
        return found
    if not path.exists():
        raise DeviceMissing(said('no_sound_file', path=path))
    return [path]


def beside(sound: Path, ending: str) -> Path:
    """Return the companion of a sound: `ice.wav` -> `ice.moved.csv`, `ice.labels.txt`."""
    return sound.with_name(f'{sound.stem}.{ending}')


def times(sound: str, options: Options) -> list[tuple[str, int]]:
    """Return name and time of change, ns, of every file that the corpus of `sound` is made of."""
    try:
        heard = [Path(sound)] if sound.endswith('.json') else all_sounds(sound, options)
        files = [(s, beside(s, 'moved.csv'), label_file(s, options)) for s in heard]
        found = [p for row in files for p in row if p is not None and p.exists()]
        return [(str(p), p.stat().st_mtime_ns) for p in found]
    except (EolError, OSError):  # gone, or going at this moment
        return []


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, hex; raises DeviceMissing if it cannot be read."""
    digest = hashlib.sha256()
    try:
        with open(path, 'rb') as file:
            while block := file.read(1 << 20):
                digest.update(block)
    except OSError as error:
        raise DeviceMissing(f'{path}: cannot be read ({error.strerror or error})') from None
    return digest.hexdigest()


def label_file(sound: Path, options: Options) -> Path | None:
    """Return the label track that the sound is cut at, if it is to be cut at one."""
    if options.segment != 'labels':
        return None
    check_file(options.labels)  # its content is part of the digest
    return Path(options.labels) if options.labels else beside(sound, 'labels.txt')


def digest(sounds: list[Path], options: Options) -> str:
    """Return the SHA-256 that stands for a corpus: what it is made of and how."""
    words = asdict(options)
    words.pop('more_sounds')  # they are among `sounds`
    if not options.regions:
        del words['regions']
    parts: list = [VERSION, ANALYSIS, words]
    if options.regions:
        parts.append([sound.stem for sound in sounds])
    for sound in sounds:
        readable = sound.is_file() and os.access(sound, os.R_OK)
        parts.append(sha256(sound) if readable else '')
        for companion in (beside(sound, 'moved.csv'), label_file(sound, options)):
            if companion is not None and companion.is_file():
                parts.append([companion.suffix, sha256(companion)])
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def cached(sounds: list[Path], options: Options) -> Corpus | None:
    """Return the corpus of these sounds if it has been made before."""
    if not any(s.is_file() for s in sounds):
        return None
    path = cached_path(sounds, digest(sounds, options))
    return read(path, lambda content: loads(content, path, trusted=True))


def cached_path(sounds: list[Path], key: str) -> Path:
    """Return where the corpus with digest `key` of the sounds at these very places is kept."""
    words = json.dumps([key, *(str(s.resolve()) for s in sounds)])
    return folders.cache('corpus') / f'{hashlib.sha256(words.encode()).hexdigest()}.json'


def save(corpus: Corpus, path: Path) -> None:
    """Write a corpus as JSON; `load` reads it back."""
    write_text(path, as_json(corpus, path.resolve().parent))


def as_json(corpus: Corpus, base: Path | None = None) -> str:
    """Return the JSON of a corpus; sounds below the folder `base` are named relative to it."""
    files = [asdict(s) for s in corpus.sources]
    for row in files:
        if base and Path(row['path']).is_relative_to(base):  # both may move house
            row['path'] = str(Path(row['path']).relative_to(base))
    rows = []
    for grain in corpus.grains:
        row = {'file': files[grain['file']]['path']}
        row.update((name, _plain(grain[name])) for name in COLUMNS)
        rows.append(row)
    head = {
        'version': VERSION,
        'sample_rate': corpus.sample_rate,
        'digest': corpus.digest,
        'x_name': corpus.x_name,
        'y_name': corpus.y_name,
        'notes': list(corpus.notes),
        'files': files,
    }
    lines = [f'{json.dumps(k)}: {json.dumps(v)},' for k, v in head.items()]
    body = ',\n'.join(json.dumps(row) for row in rows)  # one grain a line, for people and for diff
    return '{\n' + '\n'.join(lines) + '\n"grains": [\n' + body + '\n]}\n'


def load(path: Path, trusted: bool = False) -> Corpus:
    """Read a corpus; raises ConfigError if it is none, DeviceMissing if its sound is gone.

    One that is not `trusted` may have been edited: its digest is taken of the text, and a sound
    whose content is not what was described is told of in `notes`.
    """
    check_file(path)  # it names its sounds from where it lies
    try:
        data = content(path, MOST_CORPUS)
    except FileNotFoundError:
        raise DeviceMissing(
            f'{path}: no such corpus; make it with: eol corpus SOUND --output {path}'
        ) from None
    except OSError as error:
        raise ConfigError(f'{path}: {error.strerror}; give {_MADE}') from None
    return loads(data, path, trusted)


def loads(content: bytes, path: Path, trusted: bool = False) -> Corpus:
    """Return the corpus in the content of a file at `path`; raises as `load`."""
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f'{path}: not a corpus ({error}); give {_MADE}') from None
    if not isinstance(data, dict) or 'grains' not in data or 'files' not in data:
        raise ConfigError(f'{path}: not a corpus (no "files" and "grains" in it); give {_MADE}')
    if data.get('version') != VERSION:
        raise ConfigError(
            f'{path}: corpus of version {data.get("version")!r}, this program reads {VERSION}; '
            'make it again with: eol corpus'
        )
    try:
        base = Path(path).resolve().parent
        sources = tuple(
            Source(**{
                **row,
                'path': str(base / row['path']),
                'sample_rate': int(row['sample_rate']),
                'duration_s': float(row['duration_s']),
            })
            for row in data['files']
        )  # fmt: skip
        number = {row['path']: i for i, row in enumerate(data['files'])}
        grains = np.zeros(len(data['grains']), GRAIN)
        for i, row in enumerate(data['grains']):
            given = map(row.get, COLUMNS)
            values = [math.nan if value is None else float(value) for value in given]
            grains[i] = (number[row['file']], *values)
        told = [str(note) for note in data.get('notes', ())]
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ConfigError(f'{path}: a file or grain is not as it should be ({error!r})') from None
    _check(path, sources, grains)
    names = [data.get(key, axis) for key, axis in zip(('x_name', 'y_name'), AXES, strict=True)]
    for name in names:
        if not isinstance(name, str) or name not in DESCRIPTORS:
            hint = nearest(str(name), DESCRIPTORS)
            raise ConfigError(f'{path}: {name!r} is no descriptor. {hint}')
    key, notes = str(data.get('digest', '')), told
    if not trusted:
        key = hashlib.sha256(content).hexdigest()
        for source in sources:
            if not Path(source.path).is_file():
                notes.append(f'{LEFT_OUT}{source.path}: is gone')
            elif source.sha256 and sha256(Path(source.path)) != source.sha256:
                notes.append(
                    f'{source.path}: has changed since {path} was made; run eol corpus again'
                )
    return Corpus(sources, grains, names[0], names[1], key, tuple(dict.fromkeys(notes)))


def _check(path, sources, grains) -> None:
    if not len(sources) or not len(grains):
        raise ConfigError(f'{path}: the corpus is empty')
    gone = [i for i, source in enumerate(sources) if not Path(source.path).is_file()]
    if len(gone) == len(sources):
        raise DeviceMissing(
            f'{path}: its sound {sources[0].path} is gone; put it back or run eol corpus'
        )
    without = np.isin(grains['file'], gone)
    grains['x'][without] = grains['y'][without] = math.nan
    lengths = np.array([s.duration_s for s in sources])[grains['file']]
    ends = grains['start_s'] + grains['duration_s']
    bad = ~((grains['start_s'] >= 0) & (grains['duration_s'] > 0) & (ends <= lengths + 1e-3))
    bad |= ((grains['x'] < 0) | (grains['x'] > 1)) | ((grains['y'] < 0) | (grains['y'] > 1))
    if bad.any():
        i = int(np.argmax(bad))
        raise ConfigError(
            f'{path}: grain {i} lies outside its sound or outside the space '
            f'({grains[i]["start_s"]:g} s + {grains[i]["duration_s"]:g} s of {lengths[i]:g} s, '
            f'x {grains[i]["x"]:g}, y {grains[i]["y"]:g})'
        )
    if not np.isfinite(grains['x'] + grains['y']).any():
        raise ConfigError(f'{path}: no grain has a place; all are silent')


def save_csv(corpus: Corpus, path: Path) -> None:
    """Write one line per grain, with the same names as the JSON."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator='\n')
    rows.writerow(('file', *COLUMNS))
    for grain in corpus.grains:
        rows.writerow((corpus.sources[grain['file']].path, *(_plain(grain[n]) for n in COLUMNS)))
    write_text(path, text.getvalue())


def save_labels(corpus: Corpus, path: Path) -> None:
    """Write the grains of the first sound as an Audacity label track."""
    rows = [(i, g) for i, g in enumerate(corpus.grains) if g['file'] == 0]
    text = [f'{g["start_s"]:.6f}\t{g["start_s"] + g["duration_s"]:.6f}\t{i}' for i, g in rows]
    write_text(path, '\n'.join(text) + '\n')


def load_labels(path: Path) -> np.ndarray:
    """Read an Audacity label track: (n, 2) start and end in seconds, in order."""
    if not Path(path).exists():
        raise DeviceMissing(f'{path}: no such label file')
    found = []
    for row in text_table.rows(path, ('start', 'end', 'text'), ('start', 'end')):
        start, end = (row.number(name, low=0.0, high=MOST_S) for name in ('start', 'end'))
        if not start < end:
            raise row.wrong('end', f'a label must end after it starts ({start:g}, {end:g})')
        found.append((start, end))
    if not found:
        raise ConfigError(f'{path}: no labels in it')
    return np.array(sorted(found))


def load_moved(sound: Path) -> np.ndarray:
    """Read what was moved by hand: (n, 3) moment in the sound in s, x, y."""
    path = beside(sound, 'moved.csv')
    if not path.is_file():
        return np.zeros((0, 3))
    columns = ('time_s', 'x', 'y')
    high = (MOST_S, 1.0, 1.0)
    return np.array([
        [row.number(name, low=0.0, high=most) for name, most in zip(columns, high, strict=True)]
        for row in text_table.rows(path, columns, columns)
    ]).reshape(-1, 3)  # fmt: skip


def move(corpus: Corpus, grain: int, x: float, y: float) -> Path:
    """Note beside the sound that the grain now lies at x, y; return that file.

    A grain is known by a moment in its sound, so that the note survives another cut of it.
    """
    if not (0 <= x <= 1 and 0 <= y <= 1):
        raise ConfigError(f'{x:g}, {y:g}: x and y must lie in 0..1')
    sound, (start, end) = _span(corpus, grain)
    kept = [m for m in load_moved(sound) if not start <= m[0] < end]
    return _save_moved(sound, [*kept, np.array([(start + end) / 2, x, y])])


def restore(corpus: Corpus, grain: int) -> Path:
    """Forget that a grain was moved by hand; return the file beside its sound that said so."""
    sound, (start, end) = _span(corpus, grain)
    noted = load_moved(sound)
    kept = [m for m in noted if not start <= m[0] < end]
    if len(kept) == len(noted):
        raise ConfigError(said('not_moved', grain=grain))
    return _save_moved(sound, kept)


def moved(corpus: Corpus) -> list[int]:
    """Return the numbers of the grains that were moved by hand."""
    found = []
    for i, source in enumerate(corpus.sources):
        for time_s in load_moved(Path(source.path))[:, 0].tolist():
            start = corpus.grains['start_s']
            end = start + corpus.grains['duration_s']
            here = (corpus.grains['file'] == i) & (start <= time_s) & (time_s < end)
            found += np.flatnonzero(here & corpus.placed)[:1].tolist()
    return sorted(found)


def _span(corpus: Corpus, grain: int) -> tuple[Path, tuple[float, float]]:
    """Return the sound of a grain, and where in it the grain lies, s."""
    if not 0 <= grain < len(corpus):
        raise ConfigError(said('no_grain', grain=grain, last=len(corpus) - 1))
    row = corpus.grains[grain]
    start = row['start_s']
    return Path(corpus.sources[row['file']].path), (start, start + row['duration_s'])


def _save_moved(sound: Path, rows: list[np.ndarray]) -> Path:
    path = beside(sound, 'moved.csv')
    lines = [','.join(repr(_plain(v)) for v in m) for m in sorted(rows, key=lambda m: m[0])]
    write_text(path, '\n'.join(['time_s,x,y', *lines]) + '\n')
    return path


def _plain(value) -> float | None:
    return float(f'{value:.{DIGITS}g}') if math.isfinite(value) else None


def write_text(path: Path, text: str) -> None:
    """Write all or nothing: a reader never meets half a file."""
    with writing(path):
        DISK.write(path, text)
