# SPDX-License-Identifier: Apache-2.0
"""Makes the film that the README opens with, and its sound, from a rehearsal of a fixed seed.

    python -m assets.film               run the rehearsal, and film its greatest cascade
    python -m assets.film --bag DIR     film this bag of a rehearsal, run nothing

The pages themselves are filmed, in a headless Chromium: what the bag has is told to them as the
panel tells it, while their clocks stand still from image to image. So the film is smooth however
slow this machine is. Physics and visitors follow from the seed; the times are those of the run.
Needs chromium and chromedriver.
"""

import argparse
import base64
import http.server
import io
import math
import mimetypes
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import soundfile
import yaml
from PIL import Image
from rclpy.serialization import deserialize_message

from benchmarks.web_browser import start as start_browser
from eol_ros.analysis import sound
from eol_ros.analysis.bag import Bag, open_bag
from eol_ros.analysis.recorded_settings import recorded_table
from eol_ros.core import terrain
from eol_ros.core.physics.twin.hands import Visitors
from eol_ros.devices.bag.reader import BagMessage
from eol_ros.devices.files.media_folder import Pictures
from eol_ros.errors import EolError
from eol_ros.nodes.panel_streams import STREAMS
from eol_ros.ros.definitions import definition
from eol_ros.ros.topics import topic_class
from eol_ros.said import LANGUAGES
from eol_ros.settings import PanelSettings
from eol_ros.streams import blocks, corpus
from eol_ros.streams.graph import TOPICS
from eol_ros.verbs.progress import track
from eol_ros.web import notices, wire
from eol_ros.web.routes import PAGES, STATIC
from tools.make_sample_bag import rehearse

STAGE = Path(__file__).resolve().parent
ROOT = STAGE.parents[1]
SIZE = 960, 600  # of a frame, px, as in stage.css
FPS = 15
PREVIEWS = {'images': 'preview', 'display_period_s': 0.0}  # what the recorder keeps
BEFORE_S = 4.0  # of the film, before the cascade that it is about
SETTLE_S = 3.0  # before the film, in which the pages come to know the graph
QUALITY = 74  # of WebP; test/assets/test_film.py limits the size


def greatest(bag: Bag, length_s: float) -> int:
    """Return when (ns) the film begins: BEFORE_S before the cascade of the greatest area."""
    cascades = bag.table('cascades')
    onset_ns = cascades['onset'].astype('i8')
    first_ns = bag.start_ns + round((BEFORE_S + SETTLE_S + 1) * 1e9)
    last_ns = bag.end_ns - round((length_s - BEFORE_S + 1) * 1e9)
    fits = (onset_ns >= first_ns) & (onset_ns <= last_ns)
    if not fits.any():
        raise EolError(f'{bag.path}: {bag.duration_s:.0f} s are too short for this film')
    rank = cascades['area'].astype(int) * 1000 + np.minimum(cascades['size'], 999)
    best = int(np.argmax(np.where(fits, rank, -1)))
    print(f'cascade of {cascades["area"][best]} blocks, {cascades["size"][best]} slips')
    return int(onset_ns[best]) - round(BEFORE_S * 1e9)


class Told(NamedTuple):
    """What the pages are told at `log_ns`; of those with the same `sticky` only the last holds."""

    log_ns: int
    sticky: str
    payload: bytes | str


class Teller:
    """Makes of the messages of a bag what the panel would tell its pages."""

    def __init__(self, bag: Bag):
        self.bag, table = bag, recorded_table(bag)
        self.documents: dict[str, bytes] = {
            'terrain': (terrain.landscape(PanelSettings().terrain_seed) * 65535)
            .astype('<u2')
            .tobytes(),
            'lattice': wire.text(notices.lattice(table)).encode(),
        }
        self._blocks = blocks.Codec(definition(blocks.TYPE), cells=table.cells)
        self.pictures = Pictures()
        self._roster, self._day = notices.Roster(), notices.Day()
        self._streams = {bag.name(topic): name for name, (topic, _) in STREAMS.items()}

    def told(self) -> Iterator[Told]:
        """Yield everything, in the order of recording."""
        last_fit_s = 0.0
        for m in self.bag.messages():
            if m.topic in self._streams:
                name = self._streams[m.topic]
                _, packet = STREAMS[name]
                payload = packet(self._blocks.read(m.data) if name == 'blocks' else self._read(m))
                state = name not in ('slips', 'triggers', 'sound')
                yield self._one(m, name if state else '', payload)
            elif m.topic == self.bag.name('wall'):
                notice = notices.wall(self._read(m), 0.0, self.pictures.look)
                yield self._one(m, 'wall', notice)
            elif m.topic == self.bag.name('corpus'):
                message = self._read(m)
                self.documents['corpus'] = wire.text(corpus.to_json(message)).encode()
                yield self._one(m, 'corpus', {'t': 'corpus', 'digest': message.digest})
            elif m.topic == self.bag.name('cascades'):
                self._day.add(self._read(m), m.log_ns * 1e-9)
                if m.log_ns * 1e-9 > last_fit_s + 1:
                    last_fit_s = m.log_ns * 1e-9
                    self._day.fit()
                yield self._one(m, 'cascades', self._day.notice())
            elif m.topic == self.bag.name('node_states'):
                notice = self._roster.take(self._read(m), m.log_ns * 1e-9, m.log_ns * 1e-9)
                yield self._one(m, f'health {notice["node"]}', notice)

    def _read(self, m: BagMessage) -> Any:
        name = next(name for name in TOPICS if self.bag.name(name) == m.topic)
        return deserialize_message(m.data, topic_class(name))

    @staticmethod
    def _one(m: BagMessage, sticky: str, payload: Any) -> Told:
        return Told(m.log_ns, sticky, wire.text(payload) if isinstance(payload, dict) else payload)


class Arms:
    """The visitors' hands on the rim, for who looks: the twin tells the rim alone.

    Their gestures follow from the seed and the recorded rim; where on the rim a hand holds
    is left open by both: here it holds the bar to or from which it wants the rim, on the near side.
    """

    BAR_M = 0.49

    def __init__(self, bag: Bag):
        scene = yaml.safe_load(bag.about['settings'])['nodes']['twin']
        self._truth = bag.table('truth')
        self._stamps = self._truth['stamp'].astype('i8')
        self._visitors = Visitors(scene.get('seed', 1), recorded_table(bag))
        self._at, self._time_s = 0, 0.0
        self._grips: dict[int, list[complex]] = {}

    def until(self, now_ns: int) -> list[dict[str, Any]]:
        """Return the hands of the newest image, as `static/hands.js` has its fingers."""
        while self._at < len(self._stamps) and self._stamps[self._at] <= now_ns:
            self._time_s = float(self._stamps[self._at] - self._stamps[0]) * 1e-9 + 1 / 60
            pose = [self._truth[key][self._at] for key in ('rim_x', 'rim_y', 'rim_yaw')]
            self._visitors.hands(self._time_s, np.array(pose))
            self._at += 1
        return [one for reach in self._visitors.reaches for one in self._fingers(reach)]

    def _fingers(self, reach: Any) -> Iterator[dict[str, Any]]:
        place = reach.place(self._time_s)
        if place is None:
            return
        if id(reach) not in self._grips:
            x, y, yaw = reach.move
            way = complex(x, y) * complex(math.cos(place[2]), -math.sin(place[2]))
            if reach.radius:
                grips = [-1j]
            elif abs(yaw) * 0.4 > abs(way):
                grips = [-1, 1]
            else:
                grip = way / max(abs(way.real), abs(way.imag))
                grips = [grip if grip.imag <= 0 else -grip]
            self._grips[id(reach)] = grips
        for grip in self._grips[id(reach)]:
            point = self.BAR_M * complex(grip)
            turn = complex(math.cos(place[2]), math.sin(place[2]))
            hand = complex(place[0], place[1]) + turn * point
            yield {'x': hand.real, 'y': hand.imag, 'grip': [point.real, point.imag]}


class Stage:
    """Serves the pages with a clock of the film's, and the page that shows them together."""

    def __init__(self, teller: Teller):
        files = {path: STATIC / page for path, page in PAGES.items()}
        clock = (
            b'<script src="/film/clock.js"></script><link rel="stylesheet" href="/film/page.css">'
        )

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                path = self.path.partition('?')[0]
                folder, _, name = path[1:].partition('/')
                if path in files:
                    html = files[path].read_bytes()
                    body = html.replace(b'<link rel="icon"', clock + b'<link rel="icon"', 1)
                    path = '.html'
                elif folder in ('static', 'film'):
                    base = LANGUAGES.parent if name.startswith('lang/') else STATIC
                    body = ((base if folder == 'static' else STAGE) / name).read_bytes()
                elif folder == 'media':
                    found = teller.pictures.file(name)
                    path, body = f'/{found}', found.read_bytes() if found else b''
                else:
                    path, body = '.json', teller.documents.get(folder, b'{}')
                kind, encoding = mimetypes.guess_type('name' + path)
                self.send_response(200)
                self.send_header('Content-Type', kind or '')
                if encoding:  # of .svgz
                    self.send_header('Content-Encoding', encoding)
                self.send_header('Content-Length', str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *args: Any) -> None:
                pass

        self._server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Handler)
        self.address = f'http://127.0.0.1:{self._server.server_port}'
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """Serve no longer."""
        self._server.shutdown()


def film(bag: Bag, begin_ns: int, length_s: float) -> list[Image.Image]:
    """Return the images of the film, FPS a second."""
    teller, arms = Teller(bag), Arms(bag)
    told = list(teller.told())
    zero_ns = begin_ns - round(SETTLE_S * 1e9)
    known: dict[str, Told] = {one.sticky: one for one in told if one.log_ns < zero_ns}
    known.pop('', None)
    hello = {'t': 'hello', 'viewer': 1, 'now': zero_ns * 1e-9, 'pin': False, 'push': True,
             'private': []}  # fmt: skip
    first = [wire.text(hello), wire.text(notices.limits('local'))]
    waiting = [Told(zero_ns, '', text) for text in first] + list(known.values())
    waiting += [one for one in told if one.log_ns >= zero_ns]
    stage = Stage(teller)
    images, at = [], 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        driver = start_browser(profile)
        try:
            driver.set_script_timeout(120)
            size = {'width': SIZE[0], 'height': SIZE[1], 'deviceScaleFactor': 1, 'mobile': False}
            driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', size)
            driver.get(f'{stage.address}/film/stage.html?start={zero_ns // 10**6}')
            settle = round(SETTLE_S * FPS)
            for number in track(range(settle + round(length_s * FPS)), 'filming'):
                now_ns = zero_ns + round((number + 1) / FPS * 1e9)
                end = at
                while end < len(waiting) and waiting[end].log_ns <= now_ns:
                    end += 1
                script = 'const [a, b, c, done] = arguments; show(a, b, c).then(done)'
                packets = [_packet(one, zero_ns) for one in waiting[at:end]]
                driver.execute_async_script(
                    script, packets, (now_ns - zero_ns) / 1e6, arms.until(now_ns)
                )
                at = end
                if number >= settle:
                    shot = driver.execute_cdp_cmd('Page.captureScreenshot', {'format': 'png'})
                    png = io.BytesIO(base64.b64decode(shot['data']))
                    images.append(Image.open(png).convert('RGB'))
        finally:
            driver.quit()
            stage.close()
    return images


def _packet(one: Told, zero_ns: int) -> list[Any]:
    at_ms = max(one.log_ns - zero_ns, 0) / 1e6
    if isinstance(one.payload, str):
        return [at_ms, one.payload, '']
    return [at_ms, '', base64.b64encode(one.payload).decode()]


def write_film(images: list[Image.Image], path: Path) -> None:
    """Write an animated WebP."""
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=round(1000 / FPS), loop=0,
        quality=QUALITY, method=4,
    )  # fmt: skip


def write_sound(bag: Bag, begin_ns: int, length_s: float, path: Path) -> None:
    """Write the sound of the same stretch as Ogg/Opus, with short fades at both ends."""
    settings = sound.settings_of(bag)
    begin_s = (begin_ns - bag.start_ns) * 1e-9
    blocks = list(sound.rendered(bag, settings, begin_s + length_s))
    rate = settings.sample_rate
    wave = np.concatenate(blocks)[round(begin_s * rate) :, :2][: round(length_s * rate)]
    ramp = np.minimum(np.arange(len(wave)), np.arange(len(wave))[::-1]) / (0.05 * rate)
    wave = wave * np.minimum(ramp, 1.0)[:, None]
    with soundfile.SoundFile(path, 'w', rate, wave.shape[1], format='OGG', subtype='OPUS') as file:
        for start in range(0, len(wave), rate):  # in one piece libsndfile overflows its stack
            file.write(wave[start : start + rate])


def main() -> int:
    """Rehearse, film, render, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=60.0, help='length of the rehearsal')
    parser.add_argument('--length', type=float, default=12.0, help='length of the film, s')
    parser.add_argument('--bag', metavar='DIR', help='film this bag, run nothing')
    parser.add_argument(
        '--begin', type=float, help='s from its start (default: the greatest cascade)'
    )
    parser.add_argument('--stills', metavar='DIR', type=Path, help='keep each image here, too')
    parser.add_argument('-o', '--output', metavar='DIR', type=Path, default=ROOT / 'docs' / 'img')
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='eol-film-') as place:
        try:
            bag = open_bag(args.bag or rehearse(Path(place), args.seconds, PREVIEWS))
            begin_ns = greatest(bag, args.length)
            if args.begin is not None:
                begin_ns = bag.start_ns + round(args.begin * 1e9)
            images = film(bag, begin_ns, args.length)
            if args.stills:
                args.stills.mkdir(parents=True, exist_ok=True)
                for i, image in enumerate(images):
                    image.save(args.stills / f'{i:04}.png')
            write_film(images, args.output / 'film.webp')
            write_sound(bag, begin_ns, args.length, args.output / 'film.ogg')
        except (EolError, subprocess.CalledProcessError) as error:
            print(f'no film: {error}', file=sys.stderr)
            return 1
    for name in ('film.webp', 'film.ogg'):
        print(f'{args.output / name}: {(args.output / name).stat().st_size / 1e6:.2f} MB')
    return 0


if __name__ == '__main__':
    sys.exit(main())
