# SPDX-License-Identifier: Apache-2.0
"""The part of `eol bench soak` in which everything is killed, stopped, filled and pulled out."""

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from support import fake_board
from support.fake_clock import FakeClock
from support.jack import Jack
from support.running import Graph, busy, stand_in

from benchmarks import web_browser
from benchmarks.soak_observer import Observer
from benchmarks.soak_proof import Held, growth, held, prove
from eol_ros import interrupts, parent_death
from eol_ros.bringup.supervisor import FED_BY
from eol_ros.errors import EolError
from eol_ros.verbs.progress import track

BACK_S = 10.0  # a fault must be over within this
PATIENCE_S = 120.0  # nothing that takes longer comes back at all
HEALTHY_S = 65.0  # who was killed is left alone so long, as its back-off starts again after 60 s
SETTLED_S = 1.5  # all must be well for so long: a heartbeat comes each second
HELD_S = 8.0  # how long what is pulled out stays out
LOOK_S = 10.0  # between two looks at memory
NOTICES = 'which way round', 'messages dropped'
DISK = '1g'  # on which the bags are, where one can be mounted
# Between the kills: how often in two hours.
EXTRAS_IN_2_H = {
    'clock steps': 40,
    'disk full': 40,
    'board pulled out': 40,
    'sound card pulled out': 40,
    'page reloaded': 40,
    'eight busy processes': 10,
}
CLOCK_STEPS_S = (-3600.0, 86400.0 * 30, -86400.0 * 30)


class Soak:
    """The rehearsal and all that it stands on, with a way to break each of it."""

    def __init__(self, folder: Path, seed: int, fps: float):
        self.folder, self.chance, self.fps = folder, random.Random(seed), fps
        self.events: list[dict[str, Any]] = []
        self.looks: list[dict[str, Held]] = []
        self.left_out: list[str] = []  # faults that this machine does not allow, and why
        self.offset_s = 0.0  # of the system clock from the true time
        self.hit_s: dict[str, float] = {}
        self.observer: Observer | None = None
        self.observed: dict[str, Any] = {}
        self.log = folder / 'rehearsal.log'  # that of the graph: faults stand between its lines
        self._stack = contextlib.ExitStack()
        try:
            self._begin()
        except BaseException:
            self._stack.close()
            raise
        self.observer = Observer(folder / 'observed.jsonl', folder / 'bags', self.graph.domain)

    def _begin(self) -> None:
        self.clock = FakeClock(self.folder)
        self.jack = Jack('eol-soak')
        self.jack.start()
        self._stack.callback(self.jack.stop)
        self.board_port = self.folder / 'board'
        self.board: subprocess.Popen | None = None
        self.plug()
        self._stack.callback(self.unplug)
        bags = self.folder / 'bags'
        bags.mkdir()
        self._mount(bags)
        path = stand_in('rehearsal', self.folder, film=None, bag=None)
        values = yaml.safe_load(path.read_text())
        values['nodes']['leds'] = {'port': str(self.board_port)}
        values['nodes']['twin'] = {'fps': self.fps}
        values['nodes']['sound']['latency_max_s'] = 1.0  # a busy machine makes more than 0.1 s late
        values['nodes']['recorder'] = {
            'images': 'around_slips', 'images_max_gb': 0.2, 'keep_gb': 0.6, 'min_free_gb': 0.1,
            'split_minutes': 10.0,
        }  # fmt: skip
        with socket.create_server(('127.0.0.1', 0)) as free:  # the same for every life of the panel
            values['nodes']['panel'] = {'port': (port := free.getsockname()[1])}
        path.write_text(yaml.safe_dump(values, sort_keys=False))
        environment = {**self.clock.environment, **self.jack.environment}
        self.graph = Graph(path, bags, watched=('blocks',), environment=environment)
        self._stack.callback(self._end)
        self.graph.wait_until_ok()
        self.page: Any = None
        try:
            self.page = web_browser.start(self.folder / 'profile')
        except EolError as error:
            self.left_out.append(f'page reloaded: {error}')
        else:
            self._stack.callback(self.page.quit)
            self.page.set_window_size(640, 480)  # it is drawn by software, beside all else
            self.page.get(f'http://127.0.0.1:{port}/')
        self.await_well(self._linked)

    def _mount(self, bags: Path) -> None:
        """Give the bags a disk of their own, which can be filled."""
        done = subprocess.run(
            ['mount', '-t', 'tmpfs', '-o', f'size={DISK}', 'none', str(bags)],
            capture_output=True, check=False,
        )  # fmt: skip
        if done.returncode == 0:
            self._stack.callback(lambda: subprocess.run(['umount', '-l', str(bags)], check=False))
        else:
            self.left_out.append(f'disk full: {done.stderr.decode().strip()}')

    def _end(self) -> int:
        if self.graph.process.poll() is None:
            self.graph.process.send_signal(signal.SIGCONT)
        return self.graph.stop()

    def _linked(self) -> bool:
        if self.page is None:
            return True
        with contextlib.suppress(Exception):  # whatever a page says that is just being loaded
            return bool(self.page.execute_script('return window.eol && eol.link.viewer'))
        return False

    def prove(self) -> tuple[int, dict[str, Any]]:
        """Stop the graph; return its exit code and what its bags prove."""
        self.observed = self.observer.stop() if self.observer else {}
        return self._end(), prove(self.folder / 'bags')

    def close(self) -> None:
        """Stop all; the bags stay until then."""
        self._stack.close()

    def plug(self) -> None:
        """Put the board in."""
        words = [fake_board.__file__, '--link', str(self.board_port)]
        self.board = subprocess.Popen(
            [sys.executable, *words], stdout=subprocess.PIPE, text=True, stderr=subprocess.DEVNULL,
            preexec_fn=parent_death.following(),
        )  # fmt: skip
        assert self.board.stdout is not None
        self.board.stdout.readline()

    def unplug(self) -> None:
        """Pull the board out."""
        assert self.board is not None
        self.board.kill()
        self.board.wait()

    def rows(self) -> dict[str, dict[str, Any]] | None:
        """Return the status of every node, or None where nobody answers."""
        try:
            return {row['node']: row for row in self.graph.status()['nodes']}
        except EolError:
            return None

    def well(self) -> bool:
        """Whether every node is OK and gets what it lives on, and blocks are published.

        Two notices do not count. After the camera was gone, which way round the lattice lies may
        stay open, for the board on the pty feels no knocks; that messages were dropped is said for
        a while after it is over.
        """
        rows, seen = self.rows(), self.graph.watch.seen['blocks']
        for row in (rows or {}).values():
            notice = any(words in row['text'] for words in NOTICES)
            deaf = row['node'] in FED_BY and not row['rate'] > 0.0
            if (row['level'] and not notice) or row['text'] == 'starting' or deaf:
                return False
        fresh = bool(rows and seen) and time.time_ns() - seen[-1][1] < 1e9
        del seen[:-1]  # hours of them are of no use
        return fresh

    def await_well(self, too: Callable[[], bool] = lambda: True) -> float:
        """Wait until all is well and stays so, and `too`; return how long it took in seconds."""
        begun = time.monotonic()
        since = None
        while since is None or time.monotonic() - since < SETTLED_S:
            well = self.well() and too()
            since = (since or time.monotonic()) if well else None
            if time.monotonic() - begun > PATIENCE_S:
                rows = self.rows() or {}
                bad = {n: row['text'] for n, row in rows.items() if row['level']}
                raise EolError(f'not back after {PATIENCE_S:g} s: {bad or "nobody answers"}')
            if self.graph.process.poll() is not None:  # as a service manager would
                self.graph.start()
            time.sleep(0.1)
        return since - begun

    def fault(self, kind: str, target: str, do: Callable[[], Any], too=lambda: True) -> None:
        """Do something bad; tell how long it took until all was well again."""
        before = {row['pid']: n for n, row in (self.rows() or {}).items()}
        with self.log.open('a') as log:
            print(f'--- {time.time():.3f} {kind} ({target})', file=log, flush=True)
        fellows = do() or set()
        try:
            back_s = self.await_well(too)
        except EolError as error:
            raise EolError(f'{kind} ({target}): {error}') from None
        after = {row['pid'] for row in (self.rows() or {}).values()}
        others = {n for pid, n in before.items() if pid not in after} - set(fellows)
        self.events.append({'kind': kind, 'back_s': round(back_s, 2), 'others': sorted(others)})

    def strike(self, number: signal.Signals) -> None:
        """Kill or stop one of those that were left alone the longest."""
        pids = {'+'.join(names): pid for pid, names in self.graph.pids().items()}
        while not (free := [n for n in pids if self._rested(n)]):
            time.sleep(0.2)
        oldest = sorted(free, key=lambda n: self.hit_s.get(n, 0.0))[:3]
        name = self.chance.choice(oldest)
        pid = pids[name]
        fellows = set(name.split('+'))

        def do() -> set[str]:
            if name == 'bringup' and number == signal.SIGSTOP:
                os.kill(pid, number)
                time.sleep(HELD_S)  # nodes go on meanwhile
                os.kill(pid, signal.SIGCONT)
                return set()
            os.kill(pid, number)
            return {n for names in pids for n in names.split('+')} if name == 'bringup' else fellows

        def replaced() -> bool:
            if name == 'bringup':
                return number == signal.SIGSTOP or self.graph.process.pid != pid
            rows = self.rows()
            return bool(rows) and rows[name.split('+')[0]]['pid'] != pid

        words = {signal.SIGKILL: 'kill -9', signal.SIGSTOP: 'kill -STOP'}
        self.fault(f'{words[number]} {name}', name, do, replaced)
        self.hit_s[name] = time.monotonic()

    def _rested(self, name: str) -> bool:
        return time.monotonic() - self.hit_s.get(name, -HEALTHY_S) >= HEALTHY_S

    def extra(self, kind: str, count: int) -> None:
        """Do one of the faults that are no kill, for the `count`-th time."""
        if kind == 'clock steps':
            step_s = CLOCK_STEPS_S[count % len(CLOCK_STEPS_S)]
            self.offset_s += step_s
            self.fault(kind, f'{step_s:+g} s', lambda: self.clock.set(round(self.offset_s * 1e9)))
        elif kind == 'disk full':
            self.fault(kind, 'bags', self._fill)
        elif kind == 'board pulled out':
            self.fault(kind, 'board', lambda: self._pull(self.unplug, self.plug))
        elif kind == 'sound card pulled out':
            self.fault(kind, 'card', self._pull_card, self._plays)
        elif kind == 'page reloaded':
            self.fault(kind, 'page', self.page.refresh, self._linked)
        elif kind == 'eight busy processes':
            self.fault(kind, 'processor', self._busy)

    def _pull(self, out: Callable[[], None], back: Callable[[], None]) -> None:
        out()
        time.sleep(HELD_S)
        back()

    def _pull_card(self) -> set[str]:
        self._pull(self.jack.stop, self.jack.start)
        return {'sound'}  # PortAudio ends a process whose server is gone

    def _plays(self) -> bool:
        return 'playing on' in (self.rows() or {}).get('sound', {}).get('text', '')

    def _fill(self) -> None:
        filler = self.folder / 'bags' / 'filler'
        space = os.statvfs(self.folder / 'bags')
        # Without a buffer, which would be written when the file is closed.
        with filler.open('wb', buffering=0) as file, contextlib.suppress(OSError):
            os.posix_fallocate(file.fileno(), 0, space.f_bavail * space.f_frsize)
        with filler.open('ab', buffering=0) as file, contextlib.suppress(OSError):
            while True:  # what became free meanwhile
                file.write(bytes(1 << 16))
        time.sleep(HELD_S)
        filler.unlink()

    def _busy(self) -> None:
        with busy(8):
            time.sleep(30)


def measure(folder: Path, hours: float, seed: int, fps: float = 60.0) -> dict[str, Any]:
    """Break things until `hours` are over; return the figures."""
    folder = Path(tempfile.mkdtemp(prefix='faults-', dir=folder))
    soak = Soak(folder, seed, fps)
    faults: list[str] = []
    begun = time.monotonic()
    with contextlib.closing(soak):
        try:
            for _ in track(_steps(soak, hours), 'faults', total=100):
                pass
        except EolError as error:
            faults.append(str(error))
        except KeyboardInterrupt:  # it ends the graph, too
            interrupts.caught()
        took_s = time.monotonic() - begun
        code, bags = soak.prove()
    faults += unreported(soak.observed)
    faults += [f'exit code {code}'] if code else []
    faults += bags.pop('faults')
    rows = growth(soak.looks)
    faults += [
        f'{row["name"]} grows: {row}' for row in rows if row['growth_mb'] and not row['flat']
    ]
    return {
        'hours': round(took_s / 3600, 4), 'left_out': soak.left_out, 'observer': soak.observed,
        'growth': rows, 'bags': bags, **summary(soak.events, faults),
    }  # fmt: skip


def unreported(observed: dict[str, Any]) -> list[str]:
    """Return the silences that no status reported, as faults."""
    return [
        f'{one["source"]}: nothing for {one["seconds"]:g} s, and no status said so'
        for one in observed.get('unreported', ())
    ]


def summary(events: list[dict[str, Any]], faults: list[str]) -> dict[str, Any]:
    """Return what is told of events, and of faults those that the events show too."""
    slow = [e for e in events if e['back_s'] > BACK_S]
    faults = [f'{e["kind"]}: back after {e["back_s"]:g} s' for e in slow] + faults
    faults += [f'{e["kind"]}: {", ".join(e["others"])} went with it' for e in events if e['others']]
    return {
        'count': len(events),
        'kills': sum(e['kind'].startswith('kill') for e in events),
        'within_10_s': len(events) - len(slow),
        'disturbed': sum(len(e['others']) for e in events),
        'kinds': _kinds(events),
        'faults': faults,
    }


def _steps(soak: Soak, hours: float) -> Iterator[int]:
    """Yield once a hundredth of the time; faults come one after another meanwhile."""
    extras = []
    left_out = {words.partition(':')[0] for words in soak.left_out}
    for kind, count in EXTRAS_IN_2_H.items():
        if kind in left_out:
            continue
        n = max(round(count * hours / 2), 1)
        extras += [((k + soak.chance.random()) / n * hours * 3600, kind, k) for k in range(n)]
    extras.sort()
    begun = looked = time.monotonic()
    done, number = 0, signal.SIGKILL
    while done < 100:
        now = time.monotonic() - begun
        if extras and extras[0][0] <= now:
            _, kind, count = extras.pop(0)
            soak.extra(kind, count)
        else:
            soak.strike(number)
            number = signal.SIGSTOP if number == signal.SIGKILL else signal.SIGKILL
        if time.monotonic() - looked > LOOK_S:
            soak.looks.append(held(soak.graph))
            looked = time.monotonic()
        percent = min(int(100 * (time.monotonic() - begun) / (hours * 3600)), 100)
        for _ in range(percent - done):
            yield percent
        done = max(done, percent)


def _kinds(events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    by_kind = defaultdict(list)
    for event in events:
        by_kind[event['kind']].append(event['back_s'])
    return [
        {'kind': kind, 'count': len(times), 'p50_s': float(np.median(times)),
         'p99_s': float(np.percentile(times, 99)), 'worst_s': max(times),
         'within_10_s': sum(t <= BACK_S for t in times)}
        for kind, times in sorted(by_kind.items())
    ]  # fmt: skip
