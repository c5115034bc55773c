# SPDX-License-Identifier: Apache-2.0
"""A graph that runs for a measurement or a test: started by its command, watched from outside."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from eol_ros import parent_death
from eol_ros import scene as scenes
from eol_ros.bringup import priority, status
from eol_ros.devices.board.fake import Arrival, latency_s
from eol_ros.errors import EolError
from eol_ros.streams.graph import SHORT
from support import fake_board
from support.watch import Watch

TICK_HZ = os.sysconf('SC_CLK_TCK')
WATCHED = (
    'truth', 'blocks', 'slips', 'felt_slips', 'block_taps', 'led_commands', 'grain_triggers',
    'felt_triggers',
)  # fmt: skip


def used_s(pid):
    """Return the processor time of a process, user and system, in s."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK_HZ


def free_udp_port():
    """Return a UDP port of this machine that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(('127.0.0.1', 0))
        return one.getsockname()[1]


@contextlib.contextmanager
def busy(count):
    """Have `count` processes that never sleep, each in a session, and so in a group, of its own."""
    command = [sys.executable, '-c', 'while True: pass']
    hogs = [
        subprocess.Popen(command, start_new_session=True, preexec_fn=parent_death.following())
        for _ in range(count)
    ]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def free_domain() -> int:
    """Return a DDS domain on which no graph of ours runs."""
    for turn in range(39):  # not all from the same one: two may look at the same moment
        domain = 21 + (os.getpid() + turn) % 39
        try:
            status.listen(domain).close()
            return domain
        except EolError:
            continue
    raise EolError('every DDS domain from 21 to 59 is taken: stop the graphs that run')


def board_log(scene: Path) -> Path:
    """Return where the arrivals at the board of a scene are written."""
    return scene.with_name(f'{scene.stem}.board.csv')


class Graph:
    """`python -m eol_ros.bringup SCENE` as a child, a board on a pty, a watch on the topics."""

    def __init__(
        self, scene: Path, bags: Path | None = None, watched=WATCHED, keep=(), environment=None
    ):
        """environment: what its processes are given beside that of this one."""
        self.domain = free_domain()
        self.board: subprocess.Popen[str] | None = None
        self.board_log = board_log(scene)
        values = scenes.plain(scenes.load(scene))
        self.replays = 'replay' in values['nodes']
        leds = values['nodes'].get('leds')
        if leds is not None and leds['port'] == 'pty':
            self.board = subprocess.Popen(
                [sys.executable, fake_board.__file__, '--log', str(self.board_log)],
                stdout=subprocess.PIPE,
                text=True,
                preexec_fn=parent_death.following(),
            )
            assert self.board.stdout is not None
            leds['port'] = self.board.stdout.readline().strip()
        sound = values['nodes'].get('sound')
        if sound is not None and not sound['wav']:
            sound['wav'] = str(scene.with_name(f'{scene.stem}.wav'))
        file = scene.with_name(f'{scene.stem}.running.yaml')
        file.write_text(yaml.safe_dump(values, sort_keys=False))
        self._command = [sys.executable, '-m', 'eol_ros.bringup', str(file)]
        if values['nodes']['recorder']:
            self._command += ['--bag', str(bags or scene.with_name(f'{scene.stem}.bags'))]
        self._environment = {
            **os.environ, 'ROS_DOMAIN_ID': str(self.domain), **(environment or {})
        }  # fmt: skip
        self._environment.pop('FASTRTPS_DEFAULT_PROFILES_FILE', None)
        self.log = scene.with_name(f'{scene.stem}.log')
        self.log.unlink(missing_ok=True)
        self.start()
        self.watch = Watch(watched, self.domain, keep, self.replays)
        if values.get('real_time'):  # messages reach it when they reach light and sound
            priority.step_ahead(os.getpid(), SHORT, main=False)
        self.begin_ns = 0

    def __enter__(self) -> 'Graph':
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Start its bringup; again, where that has ended."""
        with self.log.open('a') as log:
            self.process = subprocess.Popen(
                self._command, env=self._environment, stderr=log, stdout=subprocess.DEVNULL,
                preexec_fn=parent_death.following(signal.SIGTERM),  # it ends its nodes in order
            )  # fmt: skip

    def stop(self) -> int:
        """Stop it as a person would; return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            code = self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        finally:
            self.watch.close()
            if self.board is not None and self.board.poll() is None:
                self.board.send_signal(signal.SIGINT)
                self.board.communicate(timeout=10)
        return code

    def status(self) -> dict[str, Any]:
        """Return what `eol status --json` says."""
        return status.ask(self.domain)

    def node(self, name: str) -> dict[str, Any]:
        """Return the state of one node."""
        return next(row for row in self.status()['nodes'] if row['node'] == name)

    def restarts(self) -> list[str]:
        """Return what bringup said of nodes that it had to start again."""
        said = self.log.read_text().splitlines()
        return [line for line in said if 'start again' in line or 'starting again' in line]

    def wait_until_ok(self, timeout_s: float = 180.0) -> float:
        """Wait until every node is ok, not counting a compilation; return the seconds it took."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                raise EolError(f'the graph has ended: {self.log.read_text().strip()}')
            try:
                answer = self.status()
                if answer['all_ok_s'] is not None:
                    return answer['all_ok_s']
                if any(row['text'].startswith('compiling') for row in answer['nodes']):
                    deadline = time.monotonic() + timeout_s  # a cold cache is no fault of the graph
            except EolError:
                pass
            time.sleep(0.05)
        raise EolError(f'not all OK within {timeout_s:g} s: {self.log.read_text().strip()}')

    def mark(self) -> None:
        """Begin to measure."""
        self.begin_ns = time.time_ns()
        self._begin_cpu = self._cpu()
        self._begin_machine = _machine_s()
        self._begin_values = {row['node']: row['values'] for row in self.status()['nodes']}

    def pids(self) -> dict[int, list[str]]:
        """Return its processes, each with the names of its nodes; bringup is one of them."""
        pids: dict[int, list[str]] = {}
        for row in self.status()['nodes']:
            pids.setdefault(row['pid'], []).append(row['node'])
        pids[self.process.pid] = ['bringup']
        return pids

    def _cpu(self) -> dict[int, float]:
        used = {}
        for pid in self.pids():
            used[pid] = used_s(pid)
        return used

    def figures(self) -> dict[str, Any]:
        """Return images, losses, processor and memory since `mark`."""
        span_s = (time.time_ns() - self.begin_ns) * 1e-9
        used = self._cpu()
        rows = {row['node']: row for row in self.status()['nodes']}
        nodes = {}
        for pid, names in self.pids().items():
            text = Path(f'/proc/{pid}/smaps_rollup').read_text()
            pss_kb = int(re.search(r'^Pss:\s+(\d+)', text, re.M)[1])  # type: ignore[index]
            share = 100 * (used[pid] - self._begin_cpu.get(pid, 0.0)) / span_s
            nodes['+'.join(names)] = {
                'cpu_percent': round(share, 1),
                'pss_mb': round(pss_kb / 1024, 1),
                'text': rows.get(names[0], {}).get('text', ''),
                'values': rows.get(names[0], {}).get('values', {}),
            }
        stamps = self._stamps('blocks')
        return {
            'processes': len(nodes),
            'cpu_percent': round(sum(row['cpu_percent'] for row in nodes.values()), 1),
            'pss_mb': round(sum(row['pss_mb'] for row in nodes.values()), 1),
            **self.machine(),
            'real_time': self.status()['real_time'],
            'images_per_s': round((len(stamps) - 1) / ((stamps[-1] - stamps[0]) * 1e-9), 3)
            if len(stamps) > 1
            else 0.0,
            'lost': self.lost(),
            'nodes': nodes,
        }

    def machine(self) -> dict[str, float]:
        """Return shares of the machine's processors since `mark`, in percent.

        idle_percent: without work; stolen_percent: what a virtual machine's host gave to others.
        """
        passed_s, idle_s, stolen_s = (now - then for now, then in zip(
            _machine_s(), self._begin_machine, strict=True))  # fmt: skip
        return {
            'idle_percent': round(100 * idle_s / passed_s, 1),
            'stolen_percent': round(100 * stolen_s / passed_s, 1),
        }

    def latencies(self, topic: str) -> dict[str, float] | None:
        """Return the summary of stamp to arrival, in ms; the first message of each stamp counts."""
        first: dict[int, int] = {}
        for stamp, arrival in self.watch.seen[topic]:
            if stamp >= self.begin_ns:
                first.setdefault(stamp, arrival - stamp)
        return summary([late * 1e-6 for late in first.values()])

    def _stamps(self, topic: str) -> list[int]:
        return sorted(s for s, _ in self.watch.seen[topic] if s >= self.begin_ns)

    def lost(self) -> dict[str, int]:
        """Return images that were given and did not arrive, per reader, since `mark`."""
        tracked = set(self._stamps('blocks'))
        lost = {}
        given = self._stamps('truth')
        if given and tracked:  # the last ones may still be on their way
            lost['tracker'] = len([s for s in given if s not in tracked and s <= max(tracked)])
        elif len(tracked) > 2:  # a camera keeps its beat: a gap of two periods is a lost image
            gaps = np.diff(sorted(tracked)) / np.median(np.diff(sorted(tracked)))
            lost['tracker'] = int(np.sum(np.maximum(np.rint(gaps) - 1, 0)))
        for node, name in (('recorder', 'lost'), ('camera', 'dropped')):
            row = next((r for r in self.status()['nodes'] if r['node'] == node), None)
            if row is not None and name in row['values']:
                lost[node] = row['values'][name] - self._begin_values[node].get(name, 0)
        return lost

    def arrivals(self) -> list[Arrival]:
        """Return the packets that have reached the board."""
        rows = [line.split(',') for line in self.board_log.read_text().splitlines()[1:]]
        return [Arrival(int(r[0]), r[1], int(r[2]), int(r[3])) for r in rows if len(r) == 4]

    def led_latencies(self) -> dict[str, float] | None:
        """Return the latency from image stamp to the first LED packet with it, on the pty."""
        first = self.first_light().values()
        return summary([latency_s(arrival) * 1e3 for arrival in first])

    def first_light(self) -> dict[int, Arrival]:
        """Return the first LED packet with each stamp since `mark`; keys as on the wire."""
        first: dict[int, Arrival] = {}
        for arrival in self.arrivals() if self.board_log.exists() else ():
            if arrival.stamp_us and arrival.time_ns >= self.begin_ns:
                first.setdefault(arrival.stamp_us, arrival)
        return first


def summary(ms: list[float]) -> dict[str, float] | None:
    """Return p50, p99, greatest and count."""
    if not ms:
        return None
    p50, p99 = np.percentile(ms, [50, 99])
    return {
        'p50': round(float(p50), 2),
        'p99': round(float(p99), 2),
        'max': round(max(ms), 2),
        'count': len(ms),
    }


def _machine_s() -> tuple[float, float, float]:
    """Return the time that has passed over all processors; of it, what was idle and was stolen."""
    ticks = [int(word) for word in Path('/proc/stat').read_text().splitlines()[0].split()[1:9]]
    idle, stolen = ticks[3] + ticks[4], ticks[7]  # idle and iowait; steal: proc(5)
    return sum(ticks) / TICK_HZ, idle / TICK_HZ, stolen / TICK_HZ


class Film:
    """A video of the moving twin, made once: what a camera would see, for scenes with a camera."""

    def __init__(
        self,
        folder: Path,
        seconds: float = 6.0,
        fps: float = 60.0,
        size: tuple[int, int] = (1280, 800),
    ):
        self.folder, self.seconds, self.fps, self.size = folder, seconds, fps, size
        self._file: Path | None = None

    def file(self) -> Path:
        """Return the video, rendered on first use; MJPG."""
        if self._file is None:
            self._file = self._written(self.folder / 'film.avi')
        return self._file

    def _written(self, path: Path, seed: int = 5) -> Path:
        """Write the twin, visitors at work, with OpenCV's encoder; return `path`."""
        import cv2

        from eol_ros.core.physics.twin.play import Play
        from eol_ros.core.vision.calibration.model import Calibration
        from eol_ros.core.vision.render.renderer import Renderer, RenderOptions

        renderer = Renderer(RenderOptions(), Calibration.ideal(*self.size), seed)
        play = Play(seed)
        table, image = play.table, np.empty(self.size[::-1], np.uint8)
        mjpg = cv2.VideoWriter_fourcc(*'MJPG')
        writer = cv2.VideoWriter(str(path), mjpg, self.fps, self.size, isColor=False)
        for index in range(round(self.seconds * self.fps)):
            play.advance(1 / self.fps)
            renderer.render(table.x, table.y, table.yaw, index, image, velocity=table.velocity)
            writer.write(image)
        writer.release()
        return path

    def scene(self, fps: float) -> Path:
        """Return a scene of camera and tracker, fed from the video at `fps`."""
        path = self.folder / 'film.yaml'
        camera = {'device': str(self.file()), 'fps': fps, 'loop': True}
        nodes = {'camera': camera, 'tracker': {}, 'recorder': False}
        path.write_text(json.dumps({'scene': 'film', 'nodes': nodes}))
        return path


def stand_in(
    name: str,
    folder: Path,
    film: Film,
    bag: Path | None,
    changed: dict[str, dict[str, Any]] | None = None,
    real_time: bool = False,
) -> Path:
    """Return a scene file like the shipped `name`, with stand-ins in place of its devices.

    changed: settings by node. real_time: ask for real-time priority even if the scene does not.
    """
    values = {**scenes.plain(scenes.load(name)), 'real_time': real_time}
    nodes = values['nodes']
    for node, settings in (changed or {}).items():
        nodes[node].update(settings)
    if 'camera' in nodes:
        nodes['camera'].update(device=str(film.file()), loop=True)
    path = folder / f'{name}.yaml'
    if 'twin' in nodes and 'leds' in nodes:  # its blocks speak to the board in that node
        nodes['leds']['board_log'] = str(board_log(path))
    elif 'leds' in nodes:
        nodes['leds']['port'] = 'pty'
    if 'sound' in nodes:
        nodes['sound']['card_needed'] = False
    if 'panel' in nodes:
        nodes['panel']['port'] = 0
    if 'replay' in nodes:
        if bag is None:
            raise EolError(f'{name} needs a bag: name rehearsal before it in --scenes')
        nodes['replay']['bag'] = str(bag)
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path
