# SPDX-License-Identifier: Apache-2.0
"""Make a corpus: read the sounds, cut, describe, lay out; keep what took time in the cache.

`apart` does it in another process, so that a node that only plays never carries scipy.
"""

import hashlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros import folders, parent_death
from eol_ros.core.sound import sources as several
from eol_ros.core.sound.corpus import Corpus, Source
from eol_ros.devices.corpus import corpus_file
from eol_ros.devices.corpus.corpus_file import ANALYSIS, LEFT_OUT, Options
from eol_ros.devices.files.names import is_text
from eol_ros.disk import DISK, check_file, read
from eol_ros.errors import ConfigError, DeviceMissing, EolError, writing
from eol_ros.said import said

ICE_BYTES = 11_520_000  # of samples in it
CUT = (
    'segment',
    'grain_s',
    'overlap',
    'onset_db',
    'gate_on_db',
    'gate_off_db',
    'silence_db',
)


def make_ice() -> Path:
    """Return the ice recording that ships, as a file of the cache: others may lie beside it."""
    path = corpus_file.ice_file()
    if not _is_ice(path):
        import soundfile

        from eol_ros.devices.audio import audio_file

        shipped = Path(__file__).with_name('ice.flac')
        try:
            samples, rate = soundfile.read(shipped, dtype='int16')
        except soundfile.LibsndfileError as error:
            raise ConfigError(f'{shipped}: {error.error_string}; install eol_ros again') from None
        if samples.nbytes != ICE_BYTES:
            raise ConfigError(f'{shipped}: is cut off; install eol_ros again')
        with writing(path), DISK.replacing(path) as part:
            audio_file.write(part, samples, rate, 'PCM_16')
    return path


def _is_ice(path: Path) -> bool:
    """Return whether the recording is there and was neither cut nor filled with zeros."""
    try:
        with path.open('rb') as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(0)
            head = file.read(4)
            file.seek(-min(size, 4096), os.SEEK_END)
            return head == b'RIFF' and size > ICE_BYTES and any(file.read())
    except OSError:
        return False


def of_this_machine(sound: str) -> Path:
    """Return the file `sound` of a corpus made elsewhere: the ice recording is here, too."""
    ice = os.path.basename(sound) == corpus_file.ICE and not os.path.isfile(sound)
    return make_ice() if ice else Path(sound)


def build(
    sounds: list[Path], options: Options, progress: Callable[[float], None] = lambda share: None
) -> Corpus:
    """Cut, describe and place the grains of recordings.

    Parameters
    ----------
    sounds : list of Path
        WAV, FLAC, AIFF, OGG or MP3 files.
    options : Options
        How to cut and place them.
    progress : callable
        Called with the share done, 0..1.

    Returns
    -------
    Corpus
        For `corpus_file.save`, `Selector` and `Bank`.

    Raises
    ------
    DeviceMissing
        A sound or label track is absent.
    ConfigError
        One cannot be used.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from eol_ros.devices.audio import audio_file
    >>> file = Path(tempfile.mkdtemp()) / 'noise.wav'
    >>> audio_file.write(file, np.random.default_rng(1).uniform(-0.5, 0.5, 32000), 16000)
    >>> len(build([file], Options(grain_s=0.25)))
    8
    """
    from eol_ros.core.sound.layout import arrange

    sources, grains, silent, notes = _all_analysed(sounds, options, progress)
    placed = ~silent
    if not placed.any():
        raise ConfigError(
            f'{sounds[0]}: all {len(grains)} grains are silent (below {options.silence_db:g} dB); '
            'give a louder sound or another threshold'
        )
    names = (options.x_axis, options.y_axis)
    boxes = several.regions(
        options.regions, [source.name for source in sources],
        [source.folder for source in sources],
        [Path(more).name for more in options.more_sounds] + [sound.stem for sound in sounds],
    )  # fmt: skip
    for box in dict.fromkeys(boxes):
        files = [i for i, other in enumerate(boxes) if other == box]
        here = np.flatnonzero(placed & np.isin(grains['file'], files))
        seen = grains[here]
        places = arrange(seen[names[0]], seen[names[1]], names, options.layout, options.blend)
        if box != several.WHOLE:
            places = np.array(box[:2]) + places * (np.array(box[2:]) - box[:2])
        grains['x'][here], grains['y'][here] = places.T
    notes += _move_by_hand(sources, grains, placed)
    key = corpus_file.digest(sounds, options)
    return Corpus(tuple(sources), grains, *names, key, tuple(notes))


def _all_analysed(
    sounds: list[Path], options: Options, progress: Callable[[float], None]
) -> tuple[list[Source], np.ndarray, np.ndarray, list[str]]:
    """Return sources, grains, which are silent and notes; a sound that cannot be used is a note.

    Raises what the first raises if none can.
    """
    sources: list[Source] = []
    parts, silences, notes = [], [], []
    left_out: list[EolError] = []
    for i, sound in enumerate(sounds):

        def share(done: float, i: int = i) -> None:
            progress((i + done) / len(sounds))

        try:
            source, grains, silent, noted = _analysed(sound, options, share)
        except EolError as error:
            left_out.append(error)
            continue
        grains['file'] = len(sources)
        sources.append(source)
        parts.append(grains)
        silences.append(silent)
        notes += noted
    if not sources:
        raise left_out[0]
    notes += [f'{LEFT_OUT}{error}' for error in left_out]
    return sources, np.concatenate(parts), np.concatenate(silences), notes


def build_cached(
    sounds: list[Path], options: Options, progress: Callable[[float], None] = lambda share: None
) -> Corpus:
    """Return the corpus of `sounds` as the cache has it, made now if it has not."""
    corpus = corpus_file.cached(sounds, options)
    if corpus is None:
        corpus = build(sounds, options, progress)
        path = corpus_file.cached_path(sounds, corpus.digest)
        corpus_file.save(corpus, path)
        corpus = corpus_file.load(path, trusted=True)  # rounded as every later reader gets it
    return corpus


def ready(sound: str, options: Options) -> Corpus | None:
    """Return the corpus of the setting `sound` if nothing has to be made for it, else None.

    `sound` is a file, a folder, a corpus JSON, or empty for the ice recording. Raises DeviceMissing
    if it is absent, ConfigError if it is no corpus.
    """
    if sound.endswith('.json'):
        if options.more_sounds or options.regions:
            raise ConfigError(
                f'{sound}: a corpus has its sounds and places already: leave more_sounds and'
                ' regions out, or name sounds'
            )
        return corpus_file.load(Path(sound))
    return corpus_file.cached(corpus_file.all_sounds(sound, options), options)


def apart(sound: str, options: Options, started: Callable = lambda child: None) -> Corpus:
    """As `ready`, but what must be made is made now, in another process.

    `started` is given the child process. Raises what the making raises.
    """
    corpus = ready(sound, options)
    if corpus is None:
        sounds = corpus_file.all_sounds(sound, options)
        order: dict = {'ice': not sound, 'sounds': [str(s) for s in sounds]}
        order |= {'options': asdict(options), 'parent': os.getpid()}
        with subprocess.Popen(
            [sys.executable, '-m', 'eol_ros.devices.corpus.corpus_build'],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
        ) as child:
            started(child)
            words = child.communicate(json.dumps(order))[1].strip()
        if child.returncode:
            kinds = {k.exit_code: k for k in (ConfigError, DeviceMissing)}
            last = (
                words.splitlines()[-1] if words else f'making the corpus: exit {child.returncode}'
            )
            raise kinds.get(child.returncode, EolError)(last)
        corpus = ready(sound, options)
    if corpus is None:
        raise EolError(f'{folders.cache("corpus")}: the corpus just made is not there; is it full?')
    return corpus


def _analysed(sound: Path, options: Options, progress):
    """Return source, grains, which are silent and notes of one sound, from the cache if it can."""
    labels = corpus_file.label_file(sound, options)
    check_file(sound)
    if not sound.is_file():
        raise DeviceMissing(said('no_sound_file', path=sound))
    if not is_text(sound):  # the messages of ROS take no other names
        raise ConfigError(f'{str(sound)!a}: its name is not UTF-8; rename the file')
    sha = corpus_file.sha256(sound)
    words = [ANALYSIS, sha, *(getattr(options, name) for name in CUT)]
    times = None if labels is None else corpus_file.load_labels(labels)
    words.append(None if times is None else times.tolist())
    path = folders.cache('grains') / (
        hashlib.sha256(json.dumps(words).encode()).hexdigest() + '.npz'
    )
    if (known := read(path, _kept)) is not None:
        rate, duration_s, grains, silent, notes = known
    else:
        from eol_ros.core.sound.descriptors import analyse
        from eol_ros.devices.audio.audio_file import read_mono

        heard = read_mono(sound)
        cuts = _cut(heard, options, times)
        grains, silent = analyse(heard.samples, heard.rate, cuts, options.silence_db, progress)
        rate, duration_s, notes = heard.rate, heard.duration_s, list(heard.notes)
        late = 0 if times is None else int((times[:, 0] >= duration_s).sum())
        if late:
            notes.append(
                f'{labels}: {late} labels begin behind the end of {sound} and are left out'
            )
        kept: dict[str, Any] = {'grains': grains, 'silent': silent, 'notes': notes}
        kept |= {'rate': rate, 'duration_s': duration_s}
        with writing(path), DISK.replacing(path) as part:
            np.savez(part, **kept)
    progress(1.0)
    return Source(str(sound.resolve()), rate, duration_s, sha), grains, silent, notes


def _kept(content: bytes) -> tuple:
    with np.load(io.BytesIO(content)) as kept:
        grains, silent, notes = (kept[name] for name in ('grains', 'silent', 'notes'))
        return int(kept['rate']), float(kept['duration_s']), grains, silent, notes.tolist()


def _cut(heard, options: Options, times: np.ndarray | None) -> np.ndarray:
    from eol_ros.core.sound import segments

    samples, rate, o = heard.samples, heard.rate, options
    if o.segment == 'chop':
        cuts = segments.chop(len(samples), rate, o.grain_s, o.overlap)
    elif o.segment == 'onset':
        cuts = segments.onset_cut(samples, rate, o.grain_s, o.onset_db)
    elif o.segment == 'gate':
        cuts = segments.gate(samples, rate, o.gate_on_db, o.gate_off_db)
    elif times is not None:
        cuts = segments.from_labels(times, len(samples), rate)
    else:
        cuts = np.array([[0, len(samples)]])
    if times is not None and (times[:, 0] >= heard.duration_s).all():
        raise ConfigError(
            f'{heard.path}: all its labels begin behind its end, {heard.duration_s:g} s: label '
            'tracks are in seconds'
        )
    if not len(cuts):
        raise ConfigError(
            f'{heard.path}: cutting it by {o.segment} leaves no grain; cut it otherwise'
        )
    return cuts


def _move_by_hand(sources, grains, placed) -> list[str]:
    """Move grains to where people have put them; return what cannot be read."""
    notes = []
    for i, source in enumerate(sources):
        try:
            moved = corpus_file.load_moved(Path(source.path))
        except EolError as error:
            notes.append(f'{LEFT_OUT}{error}')
            continue
        for time_s, x, y in moved:
            middle = grains['start_s'] + grains['duration_s'] / 2
            off = np.where((grains['file'] == i) & placed, np.abs(middle - time_s), np.inf)
            nearest = int(np.argmin(off))
            if off[nearest] <= grains['duration_s'][nearest] / 2:
                grains['x'][nearest], grains['y'][nearest] = x, y
    return notes


def _options(words: dict) -> Options:
    lists = {name: tuple(words[name]) for name in ('more_sounds', 'regions')}
    return Options(**{**words, **lists})


def _child() -> int:
    """Make what the order on stdin asks for; the parent's death is ours."""
    order = json.load(sys.stdin)
    parent_death.follow(order['parent'])
    try:
        if order['ice']:
            make_ice()
        build_cached([Path(s) for s in order['sounds']], _options(order['options']))
    except EolError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == '__main__':
    sys.exit(_child())
