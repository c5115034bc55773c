# SPDX-License-Identifier: Apache-2.0
"""How long a block's cell lasts: its firmware in an emulated ATmega328P, part by part.

The emulator counts for how long processor, radio, accelerometer and LEDs draw current, in four
states; the currents are typical ones of data sheets (docs/build/block.yaml). So this is right about
shares of time, and as right as data sheets about mA.

    at rest      nobody plays: it listens to the bridge and to its accelerometer
    played       it slips as often as a block of the shipped twin does, and flashes each time
    asleep       a minute after the last slip: it looks for a word every 4 s
    night        asleep, and the host has switched the infrared LEDs off
"""

import struct
from pathlib import Path

import numpy as np
import yaml

from benchmarks.machine import tell
from eol_ros.devices.board.firmware import RATE_HZ, EmulatedBlock, needed
from eol_ros.verbs.progress import track

HELP = "Compute a block's budget of power from its firmware, in emulation."
EXAMPLES = ['eol bench power', 'eol bench power --slips 60 --open 8 --played 0.7 --json']
CIRCUIT = Path(__file__).resolve().parents[1] / 'docs' / 'build' / 'block.yaml'
NUMBER = 12
WORD, FEELS = 0x57, 0x46
ALL = 2**25 - 1
LEARN_S = 1.0
TURN_S = 0.002  # from word to word
USABLE = 0.8  # of the capacity of a cell that has seen some hundred days


def word(infrared: int) -> bytes:
    """Return what the bridge says every 2 ms: light may fall."""
    return struct.pack('<BBBHIIB', WORD, 5, 255, 350, infrared, 0, 0).ljust(18, b'\0')


def soon_asleep() -> bytes:
    """Return the detector's numbers: it may sleep after 1000 samples, not after a minute."""
    return struct.pack('<B6HI', FEELS, 0, 0, 0, 0, 0, 0, 1000).ljust(18, b'\0')


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=6.0, help='of each state')
    parser.add_argument(
        '--slips', type=float, default=40.0, metavar='PER_MINUTE',
        help='of a block that is played with (default: 990 a minute of 25, docs/science.md)',
    )  # fmt: skip
    parser.add_argument('--open', type=float, default=10.0, metavar='H', help='hours of a day')
    parser.add_argument(
        '--played', type=float, default=0.5, metavar='SHARE', help='of these; the rest is asleep'
    )
    parser.add_argument('--json', action='store_true', help='for programs')


def at_rest(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return samples of a block that lies still: its tilt and its noise, 1/16 mg."""
    mg = np.array([31.0, -17.0]) + rng.normal(0, 5.7, (count, 2))
    return (np.rint(mg / 4) * 64).astype(np.int16)


def slip(rng: np.random.Generator) -> np.ndarray:
    """Return samples of a slip of 300 mg and 0.12 s: let go, braked, at rest."""
    samples = at_rest(rng, 200).astype(int)
    samples[:160, 0] += np.rint(16 * 300 * np.cos(np.linspace(0, np.pi, 160))).astype(int)
    return samples.astype(np.int16)


class State:
    """A block, and what it has drawn in one state."""

    def __init__(self, seed: int = 1):
        self.rng = np.random.default_rng(seed)
        self.block = EmulatedBlock(NUMBER)
        self.block.rest(at_rest(self.rng, 5000))
        self.now_s = 0.0

    def run(self, seconds: float, say: bytes, slips_s: float = 0.0) -> dict[str, float]:
        """Go on; return the share of the time in which each part drew current."""
        before, end = self.block.loads_s(), self.now_s + seconds
        begun_s, next_s = self.now_s, self.now_s + slips_s / 2
        while self.now_s < end:
            if slips_s and self.now_s >= next_s:
                self.block.feel(self.now_s, 1 / RATE_HZ, slip(self.rng))
                next_s += slips_s
            self.now_s += TURN_S
            self.block.hear(say)
            self.block.run(self.now_s, True)
        after, took_s = self.block.loads_s(), self.now_s - begun_s
        return {name: (after[name] - before[name]) / took_s for name in after}


def measure(seconds: float, slips_per_minute: float) -> dict[str, dict[str, float]]:
    """Return the shares of time by state and part."""
    found = {}
    for name in track(['at rest', 'played', 'asleep', 'night'], 'states'):
        state = State()
        state.run(LEARN_S, word(ALL))
        if name in ('asleep', 'night'):
            say = word(0 if name == 'night' else ALL)
            state.block.hear(soon_asleep())
            state.run(8.0, say)
            # whole periods of its looks for a word
            found[name] = state.run(max(8.0, 4.0 * round(seconds / 4)), say)
        else:
            every_s = 60 / slips_per_minute if name == 'played' else 0.0
            found[name] = state.run(seconds, word(ALL), every_s)
    return found


def milliamps(shares: dict[str, float], currents: dict[str, float]) -> float:
    """Return the mean current of one state."""
    told = dict(shares, radio_rest=1.0, always=1.0)
    return sum(share * currents[name] for name, share in told.items())


def budget(shares, currents, capacity_mah, open_h: float, played: float) -> dict:
    """Return mA and h of each state, and of a day."""
    ma = {name: milliamps(share, currents) for name, share in shares.items()}
    usable = USABLE * capacity_mah
    day_mah = open_h * (played * ma['played'] + (1 - played) * ma['asleep'])
    day_mah += (24 - open_h) * ma['night']
    return {
        'mA': ma,
        'hours': {name: usable / value for name, value in ma.items()},
        'mAh_a_day': day_mah,
        'days': usable / day_mah,
    }


def run(args) -> int:
    """Measure and print."""
    from eol_ros.errors import UsageError

    if not 1 <= args.seconds <= 600:
        raise UsageError(f'--seconds {args.seconds:g}: 1 to 600')
    if not 0 < args.slips <= 120:
        raise UsageError(f'--slips {args.slips:g}: above 0, 120 at most')
    if not (0 < args.open <= 24 and 0 <= args.played <= 1):
        raise UsageError('--open is above 0, 24 h at most; --played is 0 to 1')
    needed()
    raw = yaml.safe_load(CIRCUIT.read_text())
    currents = {name: entry['mA'] for name, entry in raw['currents'].items()}
    capacity = raw['parts']['BT1']['mAh']
    shares = measure(args.seconds, args.slips)
    told = budget(shares, currents, capacity, args.open, args.played)
    result = {'shares': shares, 'capacity_mAh': capacity, **told}
    tell(result, args.json, lambda found: _table(found, raw['currents'], args))
    return 0


def _table(found: dict, currents: dict, args) -> str:
    shares = found['shares']
    names = list(shares)
    lines = [
        '| share of the time | mA | ' + ' | '.join(names) + ' |',
        '| --- | --- |' + ' --- |' * len(names),
    ]
    for part in next(iter(shares.values())):
        row = ' | '.join(f'{100 * shares[name][part]:.2f} %' for name in names)
        lines.append(f'| {currents[part]["of"]} | {currents[part]["mA"]:g} | {row} |')
    for what, form in (('mA', '{:.2f}'), ('hours', '{:.0f}')):
        row = ' | '.join(f'**{form.format(found[what][name])}**' for name in names)
        says = f'hours by {USABLE:.0%} of {found["capacity_mAh"]} mAh'
        lines.append(f'| {"all, mA" if what == "mA" else says} | | {row} |')
    return '\n'.join(lines) + (
        f'\n\na day of {args.open:g} h, played with in {args.played:.0%} of them: '
        f'{found["mAh_a_day"]:.0f} mAh; {found["days"]:.1f} days'
    )
