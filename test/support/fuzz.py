# SPDX-License-Identifier: Apache-2.0
"""What comes from outside, and what reads it: targets for inputs that nobody would write.

A target has seeds (whole, good inputs) and a function that takes bytes. It may raise EolError, for
a file that is none; whatever else it raises is a fault. Run as a program this module lets Atheris
(libFuzzer) search, guided by which lines an input reaches:

    python -m support.fuzz scene -runs=1000000
"""

import os
import random
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eol_ros.errors import BagDamaged, EolError


class Target(NamedTuple):
    """What is fed, and examples of what it should be fed with."""

    feed: Callable[[bytes], object]
    seeds: list[bytes]


def target(name: str, folder: Path) -> Target:
    """Return a target; `folder` takes what it has to write, best in memory."""
    return _TARGETS[name](folder)


def names() -> list[str]:
    """Return the names of all targets."""
    return list(_TARGETS)


def tell(feed: Callable[[bytes], object], data: bytes) -> None:
    """Feed an input: an EolError must be one line, anything else goes through."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        warnings.simplefilter('ignore', BagDamaged)
        try:
            feed(data)
        except EolError as error:
            if not str(error).strip():
                raise AssertionError('an error without a word') from error


def mutations(seeds: list[bytes], count: int, seed: int):
    """Yield `count` inputs: seeds with bits flipped, parts cut, doubled, swapped and spliced."""
    rng = random.Random(seed)
    odd = [b'\x00', b'\xff', b'\x7f\xff\xff\xff', b'\xff\xff\xff\xff', b'\x80\x00\x00\x00', b'nan',
           b'1e999', b'-1', b'null', b'[]', b'{}', b'"\\ud800"', b'&a', b'*a']  # fmt: skip
    for _ in range(count):
        data = bytearray(rng.choice(seeds))
        for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
            at = rng.randrange(len(data) + 1)
            to = min(len(data), at + rng.choice((1, 1, 2, 4, 8, 64)))
            match rng.randrange(7):
                case 0 if data:
                    data[at % len(data)] ^= 1 << rng.randrange(8)
                case 1 if data:
                    data[at % len(data)] = rng.randrange(256)
                case 2:
                    del data[at:to]
                case 3:
                    data[at:at] = data[at:to] * rng.choice((1, 2, 100))
                case 4:
                    data[at:to] = rng.choice(odd)
                case 5:
                    other = rng.choice(seeds)
                    start = rng.randrange(len(other) + 1)
                    data[at:to] = other[start : start + rng.choice((1, 4, 16, 64))]
                case 6 if rng.random() < 0.2:
                    del data[at:]
        yield bytes(data)


def _serial(_folder: Path) -> Target:
    """Bytes from the blocks' board."""
    from eol_ros.core import serial_protocol as protocol

    kinds = [protocol.Pong, protocol.Knock, protocol.BlockStatus, protocol.Welcome,
             protocol.Refused]  # fmt: skip
    seeds = []
    for i, kind in enumerate(kinds):
        zeros = kind(*kind.BODY.unpack(bytes(kind.BODY.size)))
        seeds.append(protocol.encode(zeros, i) + protocol.encode(zeros, i + 1))

    def feed(data: bytes) -> None:
        decoder = protocol.Decoder()
        for part in (data[: len(data) // 2], data[len(data) // 2 :], b'\0'):
            decoder.feed(part)
        # Whatever came before, a whole packet behind a zero is read.
        assert decoder.feed(seeds[0])

    return Target(feed, seeds)


def _osc(_folder: Path) -> Target:
    """Datagrams from other programs: requests and settings."""
    from eol_ros.devices import osc
    from eol_ros.errors import EolError
    from eol_ros.streams.osc import asked_of
    from eol_ros.streams.requests import KINDS

    door = osc.OscIn(0, rate_hz=1e12)
    door.close()  # it reads packets without a socket
    seeds = [
        osc.encode('/eol/set/sound/gain_db', -3.5), osc.encode('/eol/call/move_grain', 12, 0.25, 1),
        osc.encode('/eol/set/grains/weights', 'ice 0.5', 'sea 0'),
        osc.encode('/eol/call/mute', True),
        osc.bundle(osc.IMMEDIATELY, [osc.encode('/eol/call/sleep/sound'), osc.encode('/a', 1.0)]),
    ]  # fmt: skip

    def feed(data: bytes) -> None:
        before = door.received + door.malformed
        messages = door.read(data, '127.0.0.1', 0.0, lambda host, why: None)
        assert door.received + door.malformed - before == max(len(messages), 1)
        for address, *values in messages:
            try:
                asked = asked_of(address, values, 'eol')
                assert asked is None or asked.kind in KINDS
            except EolError:
                pass  # it is refused

    return Target(feed, seeds)


def _scene(folder: Path) -> Target:
    """Scene files."""
    from eol_ros import scene

    path = folder / 'scene.yaml'
    seeds = []
    for file in scene.shipped().values():
        bags = str((file.parent / '../bags').resolve()).encode()
        seeds.append(file.read_bytes().replace(b'../bags', bags))
        (folder / file.name).write_bytes(seeds[-1])  # some include others

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        scene.load(path)

    return Target(feed, seeds)


def _corpus(folder: Path) -> Target:
    """Corpora that somebody has edited."""
    from eol_ros.core.sound.corpus import AXES, GRAIN, Corpus, Source
    from eol_ros.devices.corpus import corpus_file

    sound = folder / 'ice.wav'
    sound.write_bytes(_wav_bytes())
    grains = np.zeros(2, GRAIN)
    grains['duration_s'], grains['x'], grains['y'] = 0.01, 0.5, 0.25
    source = Source(str(sound), 8000, 0.1, corpus_file.sha256(sound))
    whole = corpus_file.as_json(Corpus((source,), grains, *AXES, 'digest'), folder)
    path = folder / 'corpus.json'

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        corpus_file.load(path)

    return Target(feed, [whole.encode()])


def _wav_bytes() -> bytes:
    import io

    import soundfile

    file = io.BytesIO()
    samples = np.sin(np.arange(800) / 5.0).astype(np.float32)
    soundfile.write(file, samples, 8000, format='WAV', subtype='PCM_16')
    return file.getvalue()


def _wav(folder: Path) -> Target:
    """Sound files."""
    from eol_ros.devices.audio import audio_file

    path = folder / 'sound.wav'

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        sound = audio_file.read_mono(path)
        assert np.isfinite(sound.samples).all()

    return Target(feed, [_wav_bytes()])


def _zeros(topic: str) -> bytes:
    """Return a serialised message of a topic whose values are all zero or empty."""
    from rclpy.serialization import serialize_message

    from eol_ros.ros.topics import topic_class

    return serialize_message(topic_class(topic)())


def _mcap(folder: Path) -> Target:
    """Bags, as tables and message by message."""
    from eol_ros.analysis.bag import open_bag
    from eol_ros.devices.bag.mcap_file import BagTopic
    from eol_ros.devices.bag.reader import BagReader
    from eol_ros.devices.bag.writer import BagWriter
    from eol_ros.ros.definitions import describe

    about = describe('slips')
    writer = BagWriter(folder / 'run', [BagTopic('/eol/slips', **about)], {'scene': 'x'})
    message = _zeros('slips')
    for i in range(20):
        writer.write('/eol/slips', message, 1_000_000_000 + i, 1_000_000_000 + i)
    writer.close()
    [whole] = (folder / 'run').glob('*.mcap')
    path = folder / 'fuzzed.mcap'

    def feed(data: bytes) -> None:
        path.write_bytes(data)
        for _ in BagReader(path).messages():
            pass
        bag = open_bag(path)
        for topic in bag.topics:
            bag.table(topic)

    return Target(feed, [whole.read_bytes()])


def _cdr(_folder: Path) -> Target:
    """Messages of every type that the graph has, cut and bent."""
    from eol_ros.ros.definitions import describe
    from eol_ros.streams import cdr

    topics = 'slips', 'blocks', 'corpus', 'requests', 'wall'
    abouts = [describe(name) for name in topics]
    decoders = [cdr.Decoder(a['type'], a['definition']) for a in abouts]
    seeds = [bytes([i]) + _zeros(topic) for i, topic in enumerate(topics)]

    def feed(data: bytes) -> None:
        decoder = decoders[data[0] % len(decoders)] if data else decoders[0]
        decoder.table([data[1:]])

    return Target(feed, seeds)


_TARGETS = {
    'serial': _serial, 'osc': _osc, 'scene': _scene, 'corpus': _corpus, 'wav': _wav, 'mcap': _mcap,
    'cdr': _cdr,
}  # fmt: skip


def main() -> None:
    """Search with Atheris; ends with an exit code that is not 0 at the first fault."""
    import atheris

    name = sys.argv.pop(1)
    with tempfile.TemporaryDirectory(
        dir='/dev/shm' if os.path.isdir('/dev/shm') else None
    ) as place:
        folder = Path(place)
        with atheris.instrument_imports(include=['eol_ros', 'pythonosc', 'yaml', 'mcap']):
            found = target(name, folder)
        seeds = folder / 'seeds'
        seeds.mkdir()
        for i, seed in enumerate(found.seeds):
            (seeds / str(i)).write_bytes(seed)
        atheris.Setup([*sys.argv, str(seeds)], lambda data: tell(found.feed, bytes(data)))
        atheris.Fuzz()


if __name__ == '__main__':
    main()
