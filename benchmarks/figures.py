# SPDX-License-Identifier: Apache-2.0
"""eol bench figures: all figures of docs/science.md, one command each, resumed where it stopped.

A part is a benchmark that draws. It is done when its record (docs/img/figures.json) names the same
command, sources and versions as there are here, and its figures are there; then it is not run
again. The table at the end of docs/science.md is written from the records.
"""

import argparse
import contextlib
import hashlib
import importlib
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.machine import line, machine, tell
from eol_ros import parent_death
from eol_ros.analysis import sources
from eol_ros.analysis.sweeps.work import COMPUTES
from eol_ros.errors import EolError, UsageError

HELP = 'Draw the figures of docs/science.md: what is up to date is left as it is.'
EXAMPLES = [
    'eol bench figures --list',
    'eol bench figures',
    'eol bench figures sizes mapping --again',
]
ROOT = Path(__file__).parents[1]
BEGIN, END = '<!-- figures: written by `eol bench figures` -->', '<!-- /figures -->'


@dataclass(frozen=True)
class Part:
    """A benchmark that draws: its command without --plot, and what its figures rest on.

    `expected_s` is processor time of one quiet core; `roots` are modules that it starts without
    importing them (`analysis.sources`), `files` YAML files and folders of them that it reads.
    """

    words: tuple[str, ...]
    draws: tuple[str, ...]
    starts: str
    spread: str
    expected_s: float
    roots: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    keeps: bool = False  # tables for the next run, and what they took: `spent_s` of the benchmark

    @property
    def command(self) -> str:
        """What makes these figures."""
        return ' '.join(('eol bench', *self.words))


PARTS = {
    'lyapunov': Part(
        ('chaos', '--seeds', '2', '--travel', '0.6'), ('lyapunov',), '1, 2',
        'twice the error of the mean', 60,
    ),
    'definitions': Part(
        ('definitions', '--seeds', '3'), ('definitions',), '1 to 3', 'deviation of a start', 25,
    ),
    'mapping': Part(
        ('mapping',), ('mapping',), '1', 'one realisation', 120,
        files=('config/rehearsal.yaml',),
    ),
    'table': Part(
        ('table', '--map', '--minutes', '4'), ('table_map',), '1', 'none: one start', 250,
    ),
    'sizes': Part(
        ('sizes', '--seeds', '2', '--travel', '0.02'), ('sizes', 'collapse'),
        '11, 12 (automata: 11 to 18)', 'deviation of a start', 1240,
    ),
    'critical': Part(
        ('critical',), ('critical', 'parts'), '1, 2 (hands: 1); parts 1 to 8 (hands: 1 to 4)',
        'twice the error of b; 95 % of runs', 400, COMPUTES,
        ('examples/sweeps/critical', 'examples/sweeps/parts'), keeps=True,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Places:
    """Where figures, their records, the page and the work in hand are."""

    images: Path
    page: Path
    work: Path

    @property
    def records(self) -> Path:
        """What made each figure."""
        return self.images / 'figures.json'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('parts', nargs='*', metavar='PART', help=f'of {", ".join(PARTS)} (all)')
    parser.add_argument('--list', action='store_true', help='tell what would be run, run nothing')
    parser.add_argument('--again', action='store_true', help='also what is up to date')
    parser.add_argument('--json', action='store_true', help='what would be run, as JSON')


def run(args: argparse.Namespace) -> int:
    """List, or draw what is not up to date."""
    wrong = [name for name in args.parts if name not in PARTS]
    if wrong:
        raise UsageError(f'{", ".join(wrong)}: no such part; there are {", ".join(PARTS)}')
    places = Places(ROOT / 'docs/img', ROOT / 'docs/science.md', ROOT / 'build/figures')
    chosen = {name: part for name, part in PARTS.items() if name in (args.parts or PARTS)}
    states = {name: state(name, part, places) for name, part in chosen.items()}
    todo = {n: p for n, p in chosen.items() if args.again or states[n] != DONE}
    rows = [
        {'part': n, 'command': p.command, 'expected_s': p.expected_s, 'state': states[n]}
        for n, p in chosen.items()
    ]
    tell({'parts': rows}, args.json, lambda result: listed(chosen, states, todo))
    sys.stdout.flush()
    if not args.list:
        draw(todo, places)
    return 0


DONE = 'up to date'


def state(name: str, part: Part, places: Places) -> str:
    """Return DONE, or why a part is to be run."""
    record = read_records(places).get(name)
    if record is None:
        return 'no record of what drew it'
    lost = [d for d in part.draws if not (places.images / f'{d}.png').exists()]
    if lost:
        return f'{", ".join(lost)}.png not there'
    if record['command'] != part.command:
        return f'drawn by {record["command"]}'
    changed = [key for key, value in made_by(part).items() if record['made_by'].get(key) != value]
    return f'drawn with other {", ".join(changed)}' if changed else DONE


def read_records(places: Places) -> dict[str, Any]:
    """Return what is known of each part that has run."""
    try:
        return dict(json.loads(places.records.read_text(encoding='utf-8')))
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise EolError(f'{places.records}: not JSON ({error}); remove it') from None


def made_by(part: Part, root: Path = ROOT) -> dict[str, str]:
    """Return a digest of the code and the files that a part's figures rest on, and versions.

    root: the checkout that is asked. The words of its code and files do not count: see `sources`.
    """
    from importlib import metadata

    import yaml

    bench = f'benchmarks.{part.words[0]}'
    roots = (f'{bench}.add_arguments', f'{bench}.run', 'benchmarks.picture', *part.roots)
    digest = hashlib.blake2b(sources.digest(roots, root).encode(), digest_size=6)
    for path in (root / name for name in part.files):
        for file in sorted(path.rglob('*.yaml')) if path.is_dir() else [path]:
            content = yaml.safe_load(file.read_text(encoding='utf-8'))
            digest.update(f'{file.relative_to(root).as_posix()} {content}'.encode())
    versions = {name: metadata.version(name) for name in ('numpy', 'scipy', 'numba')}
    return {'sources': digest.hexdigest(), **versions}


def listed(chosen: dict[str, Part], states: dict[str, str], todo: dict[str, Part]) -> str:
    """Return what would be run, and how much processor time that takes."""
    lines = [
        f'{name:12} {_time(part.expected_s):>7}  {states[name]:32} {part.command}'
        for name, part in chosen.items()
    ]
    together = _time(sum(part.expected_s for part in todo.values()))
    lines.append(f'{len(todo)} of {len(chosen)} parts to run: {together} of a quiet processor')
    return '\n'.join(lines)


def draw(todo: dict[str, Part], places: Places) -> None:
    """Run the parts one after another; each is recorded when it is done.

    Raises EolError, when all others have run, with the names of those that failed.
    """
    failed, left_s = [], sum(part.expected_s for part in todo.values())
    for number, (name, part) in enumerate(todo.items(), 1):
        print(
            f'{number} of {len(todo)}: {part.command} ({_time(left_s)} to go)',
            file=sys.stderr, flush=True,
        )  # fmt: skip
        left_s -= part.expected_s
        if not _drawn(name, part, places):
            failed.append(name)
    if failed:
        raise EolError(
            f'{", ".join(failed)}: not drawn, see {places.work}; the same command goes on there'
        )


def _drawn(name: str, part: Part, places: Places) -> bool:
    """Run a part beside the figures that are there, which are replaced when it is done."""
    folder = places.work / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    rests_on, used_s = made_by(part), _processor_s()
    # a run that was interrupted counts
    spent = places.work / f'{name}-{rests_on["sources"]}.spent'
    before_s = float(spent.read_text()) if spent.exists() else 0.0
    words = [sys.executable, '-m', 'eol_ros', 'bench', *part.words, '--plot', str(folder)]
    try:
        with open(folder / 'printed.txt', 'w', encoding='utf-8') as printed:
            status = subprocess.run(
                words, cwd=ROOT, stdout=printed, check=False, preexec_fn=parent_death.following()
            ).returncode
    finally:
        took_s = before_s + _processor_s() - used_s
        spent.write_text(f'{took_s:.1f}\n')
    if status or not all((folder / f'{d}.png').exists() for d in part.draws):
        return False
    for one in part.draws:
        shutil.copyfile(folder / f'{one}.png', places.images / f'{one}.png')
    records = read_records(places)
    records[name] = {
        'command': part.command, 'draws': list(part.draws), 'starts': part.starts,
        'spread': part.spread, 'processor_s': _whole_s(part, took_s), 'machine': line(machine()),
        'made_by': rests_on,
    }  # fmt: skip
    half = places.records.with_suffix('.half')
    half.write_text(json.dumps(records, indent=2, sort_keys=True) + '\n', encoding='utf-8')
    half.replace(places.records)
    write_table(records, places.page)
    spent.unlink()
    return True


def _whole_s(part: Part, took_s: float) -> float | None:
    """Return the processor time of a part; of one that keeps tables, of all runs they are from."""
    if part.keeps:
        spent: float | None = importlib.import_module(f'benchmarks.{part.words[0]}').spent_s()
        return spent
    return round(took_s, 1)


def _processor_s() -> float:
    used = os.times()
    return used.children_user + used.children_system


def write_table(records: dict[str, Any], page: Path) -> None:
    """Write the table of the figures into the page, between its two marks."""
    text = page.read_text(encoding='utf-8')
    with contextlib.suppress(ValueError):
        before, rest = text.split(BEGIN)
        _, after = rest.split(END)
        page.write_text(before + BEGIN + '\n' + table(records) + '\n' + END + after, 'utf-8')


def table(records: dict[str, Any]) -> str:
    """Return the rows of the figures: what drew each, from which starts, with what spread."""
    lines = ['| figure | command | starts | spread | processor |', '| --- ' * 5 + '|']
    for name, part in PARTS.items():
        figures = ', '.join(f'{d}.png' for d in part.draws)
        if name not in records:
            lines.append(f'| {figures} | `{part.command}` | {part.starts} | {part.spread} | ? |')
            continue
        r = records[name]
        took = '?' if r['processor_s'] is None else _time(r['processor_s'])
        lines.append(f'| {figures} | `{r["command"]}` | {r["starts"]} | {r["spread"]} | {took} |')
    return '\n'.join(lines)


def _time(seconds: float) -> str:
    return f'{seconds:.0f} s' if seconds < 120 else f'{seconds / 60:.0f} min'
