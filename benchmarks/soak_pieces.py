# SPDX-License-Identifier: Apache-2.0
"""Hours of a soak in pieces: what each has shown is kept, and the next goes on from there."""

import json
import time
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.soak_proof import Held, growth, prove
from eol_ros.errors import EolError

LOOK_S = 5.0  # between two looks at the graph
FILE, LOOKS = 'pieces.json', 'looks.jsonl'


class Look(NamedTuple):
    """What a graph that plays a run shows at one moment, counted from its start."""

    played_s: float
    counts: dict[str, int]  # lost, restarts, underruns, late
    held: dict[str, Held]


class Totals:
    """Counts that begin again, with each bag or with each life of their node, as totals."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._total: dict[str, int] = {}

    def add(self, counts: dict[str, int]) -> dict[str, int]:
        """Take what stands there now; return the totals."""
        for name, now in counts.items():
            last = self._last.get(name, 0)
            self._total[name] = self._total.get(name, 0) + (now - last if now >= last else now)
            self._last[name] = now
        return dict(self._total)


class Rate:
    """The highest rate that the readers keep up with.

    As TCP finds its own (Chiu and Jain 1989): a bit higher as long as nothing is lost, much lower
    when something is; not much higher than what was reached, where the replay waits for its readers
    and the machine is the bound.
    """

    WINDOW_S = 30.0  # what a decision rests on
    MORE, LESS, ABOVE = 1.15, 0.7, 1.25
    LEAST, MOST = 1.0, 100.0

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic):
        self.rate = max(rate, self.LEAST)
        self._clock = clock
        self._since: tuple[float, float, int] | None = None

    def look(self, played_s: float, lost: int) -> float | None:
        """Return the rate to change to, None: none."""
        now_s = self._clock()
        if self._since is None:
            self._since = now_s, played_s, lost
        span_s = now_s - self._since[0]
        if span_s < self.WINDOW_S:
            return None
        reached, more_lost = (played_s - self._since[1]) / span_s, lost > self._since[2]
        self._since = now_s, played_s, lost
        wanted = self.rate * self.LESS if more_lost else self.rate * self.MORE
        wanted = min(max(min(wanted, reached * self.ABOVE), self.LEAST), self.MOST)
        if abs(wanted / self.rate - 1) < 0.05:
            return None
        self.rate = round(wanted, 2)
        return self.rate


def load(file: Path, resume: bool, empty: dict[str, Any]) -> dict[str, Any]:
    """Return what `file` keeps of the pieces so far, `empty` for the first of them.

    Raises EolError where there is nothing to go on with, or something that was not asked for.
    """
    if resume:
        try:
            return json.loads(file.read_text())
        except (OSError, ValueError) as error:
            raise EolError(f'--resume: {file}: {error}') from None
    if file.exists():
        raise EolError(f'{file} is there: say --resume to go on, or name another --keep')
    file.parent.mkdir(parents=True, exist_ok=True)
    return empty


def keep(file: Path, kept: dict[str, Any]) -> None:
    """Write it to the disk; a power cut leaves what was there before or this."""
    part = file.with_suffix('.part')
    part.write_text(json.dumps(kept, indent=1))
    part.replace(file)


class Pieces:
    """The pieces of a soak in `folder`; `resume` goes on with those that are there.

    Raises EolError where there is nothing to go on with, or something that was not asked for.
    """

    def __init__(self, folder: Path, resume: bool):
        self.folder, self._file = folder, folder / FILE
        empty: dict[str, Any] = {'bag': '', 'pieces': [], 'proved': [], 'bags': {}}
        self.kept = load(self._file, resume, empty)
        if self.all and self.all[-1]['growth'] is None:  # it was killed
            self.all[-1]['cut_off'] = True
            self._close(self.all[-1], [])

    @property
    def all(self) -> list[dict[str, Any]]:
        """All pieces, the newest last."""
        return self.kept['pieces']

    @property
    def played_s(self) -> float:
        """Recorded time in all pieces."""
        return sum(piece['played_s'] for piece in self.all)

    @property
    def rate(self) -> float | None:
        """How fast the newest piece was, times real time."""
        done = [piece for piece in self.all if piece['took_s']]
        return round(done[-1]['played_s'] / done[-1]['took_s'], 2) if done else None

    def keep(self) -> None:
        """Write them to the disk."""
        keep(self._file, self.kept)

    def begin(self) -> Path:
        """Begin another; return its folder."""
        place = self.folder / f'piece-{len(self.all) + 1}'
        place.mkdir()
        self.all.append({
            'begun': datetime.now().astimezone().isoformat(timespec='seconds'), 'played_s': 0.0,
            'took_s': 0.0, 'counts': {}, 'growth': None, 'faults': [],
            'cut_off': False,
        })  # fmt: skip
        self.keep()
        return place

    def play(
        self,
        look: Callable[[], Look | None],
        until_s: float,
        longest_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> Iterator[float]:
        """Look at the newest piece until all have `until_s` of recorded time, or its time is over.

        Yields the recorded time in all after each look; a look may fail (None).
        """
        piece, begun_s = self.all[-1], clock()
        before_s = self.played_s
        with (self.folder / f'piece-{len(self.all)}' / LOOKS).open('a') as file:
            while self.played_s < until_s:
                if longest_s is not None and clock() - begun_s >= longest_s:
                    return
                sleep(LOOK_S)
                seen = look()
                if seen is None:
                    continue
                print(json.dumps(seen.held), file=file, flush=True)
                piece['took_s'] = clock() - begun_s
                piece['played_s'], piece['counts'] = seen.played_s, seen.counts
                self.keep()
                yield before_s + seen.played_s

    def end(self, faults: list[str]) -> None:
        """End the newest piece."""
        self._close(self.all[-1], faults)
        self.keep()

    def _close(self, piece: dict[str, Any], faults: list[str]) -> None:
        looks = self._looks(self.all.index(piece) + 1)
        piece['growth'], piece['faults'] = growth(looks), faults

    def _looks(self, number: int) -> list[dict[str, Held]]:
        file = self.folder / f'piece-{number}' / LOOKS
        lines = file.read_text().splitlines() if file.exists() else []
        return [
            {name: Held(*values) for name, values in json.loads(line).items()}
            for line in lines
            if line.endswith('}')  # the last may be cut off
        ]

    def prove_bags(self) -> None:
        """Prove the bags that have come since, before the recorder's budget takes them away."""
        place, bags, proved = self.folder / 'bags', self.kept['bags'], self.kept['proved']
        for name, value in prove(place, but=proved).items():
            bags[name] = bags[name] + value if name in bags else value
        self.kept['proved'] = sorted({*proved, *(path.name for path in place.iterdir())})
        self.keep()

    def figures(self) -> dict[str, Any]:
        """Return what all pieces show together."""
        took_s = sum(piece['took_s'] for piece in self.all)
        counts: dict[str, int] = {}
        for piece in self.all:
            for name, count in piece['counts'].items():
                counts[name] = counts.get(name, 0) + count
        faults = [
            f'piece {k}: {line}' for k, piece in enumerate(self.all, 1) for line in piece['faults']
        ]
        rows = [
            {'piece': k, **row}
            for k, piece in enumerate(self.all, 1)
            for row in piece['growth'] or ()
        ]
        faults += [f'piece {r["piece"]}: {r["name"]} grows: {r}' for r in rows if not r['flat']]
        last = self.all[-1]
        return {
            'run': {
                'hours': round(last['played_s'] / 3600, 4),
                'faults': last['faults']
                + [
                    f'{row["name"]} grows: {row}' for row in last['growth'] or () if not row['flat']
                ],
            },
            'hours': round(self.played_s / 3600, 2),
            'pieces': len(self.all),
            'cut_off': sum(piece['cut_off'] for piece in self.all),
            'took_hours': round(took_s / 3600, 3),
            'times_real_time': [
                round(p['played_s'] / p['took_s'], 2) for p in self.all if p['took_s']
            ],
            **{name: counts.get(name, 0) for name in ('restarts', 'lost', 'underruns', 'late')},
            'growth': rows,
            'bags': self.kept['bags'],
            'faults': faults + self.kept['bags'].get('faults', []),
        }
