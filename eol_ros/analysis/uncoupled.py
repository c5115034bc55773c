# SPDX-License-Identifier: Apache-2.0
"""The control of a twin's bag: the recorded path of its rim over blocks that are not coupled."""

import functools

import numpy as np

from eol_ros.analysis import series
from eol_ros.analysis.bag import Bag, Table
from eol_ros.analysis.recorded_settings import recorded_settings, recorded_table
from eol_ros.core.light.local import new_field
from eol_ros.core.light.looks import LOOKS
from eol_ros.core.physics import builders
from eol_ros.core.physics.drive import Drive
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.twin.live import Coupling, scene_of
from eol_ros.core.table import Table as Shape
from eol_ros.errors import EolError
from eol_ros.lab import choose
from eol_ros.lab.science import sounding, surrogates
from eol_ros.settings import GrainsSettings, LedsSettings, TwinSettings

MOST_S = series.MOST_SOUND_S  # gives the slope over three decades
IMAGES = 3  # for each value: places at 60/s, as the twin's camera sees them
FRAMES = 5  # of light for each value, 100/s


class RimPath:
    """The poses of the rim that the twin recorded; `add` takes rows of `truth` in pieces."""

    fields = {'truth': ('stamp', 'rim_x', 'rim_y', 'rim_yaw')}

    def __init__(self, bag: Bag):
        self._start_ns = bag.start_ns
        self._parts = [np.zeros((0, 4))]

    def add(self, table: Table) -> None:
        """Take the rows that follow."""
        at_s = (table['stamp'].astype('i8') - self._start_ns) * 1e-9
        rows = np.column_stack([at_s, *(table[name] for name in self.fields['truth'][1:])])
        self._parts.append(rows[(at_s >= 0) & (at_s <= MOST_S)])

    def rows(self) -> np.ndarray:
        """Return time (s from the start of the bag, rising), x, y and yaw, (n, 4)."""
        rows = np.concatenate(self._parts)
        return rows[np.unique(rows[:, 0], return_index=True)[1]]


class Uncoupled:
    """The series of the twin's table without springs between blocks, under the recorded rim.

    Each block is held by the springs to the rim that it has, or by one from above, and does not
    rotate. Slips, places and flashes are simulated; triggers and sound are those of `sounding`. The
    first hour at most is simulated, when the first series is requested.
    """

    NAME = 'the same motion of the rim without coupling'

    def __init__(
        self,
        twin: TwinSettings,
        leds: LedsSettings,
        grains: GrainsSettings,
        rim: np.ndarray,
        span_s: float,
        shape: Shape = Shape(),
    ):
        self._twin, self._leds, self._grains = twin, leds, grains
        self._rim, self._span_s, self._shape = rim, min(span_s, MOST_S), shape

    def series(self, name: str) -> np.ndarray:
        """Return the series of a name of `series.NAMES`, (n,) at RATE_HZ.

        Raises EolError where the solver gives up.
        """
        times_s, block, u = self._run
        if name == 'light':
            return self._light(times_s, block)
        if name == 'kinetic energy':
            steps, per_s = np.diff(u, axis=0), IMAGES * series.RATE_HZ
            energy = 0.5 * self._twin.block_kg * per_s**2 * np.einsum('tbi,tbi->t', steps, steps)
            whole = len(energy) // IMAGES * IMAGES
            return energy[:whole].reshape(-1, IMAGES).mean(axis=1)
        heard_s = times_s[sounding.heard(times_s, block, self._grains)]
        if name == 'triggers':
            return surrogates.event_counts(heard_s, self._span_s, series.RATE_HZ)
        power = sounding.power(heard_s, self._span_s, series.RATE_HZ, self._grains)
        return series.momentary(power) if name == 'loudness' else power

    @functools.cached_property
    def _run(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Onsets in s, their blocks, and displacements (t, blocks, 2) at IMAGES * RATE_HZ."""
        drive = {'kind': 'poses', 'par': self._rim}
        coupling = Coupling.of(self._twin)._replace(rotate=False)
        shape = self._shape
        table = scene_of(self._twin.seed, coupling, drive, self._span_s, shape)
        begin = Drive.from_mapping(drive).displacement(
            0.0, shape.rest[shape.ids]
        )  # the bag may begin anywhere
        table['u0'] = (np.asarray(table['u0']) + begin).tolist()
        table['geometric'] = False  # no pre-tension: what balanced it is gone
        apart = from_mapping(builders.uncoupled(table, shape))
        run = choose.simulate(apart, sample_s=1 / (IMAGES * series.RATE_HZ), ledger=False)
        if run.status != 'ok':
            raise EolError(f'the uncoupled table stopped at {run.t_reached:g} s: {run.status}')
        begins = run.event_start != 0
        return run.event_t[begins], shape.ids[run.event_block[begins]], run.u

    def _light(self, times_s: np.ndarray, block: np.ndarray) -> np.ndarray:
        """Return the mean level of the white LEDs, (n,)."""
        leds = self._leds
        decay_s = LOOKS[leds.look].decay_s if leds.look in LOOKS else leds.decay_s
        field = new_field(leds.flash_limit, decay_s, leds.peak, self._shape)
        levels, following = np.empty(round(self._span_s * series.RATE_HZ) * FRAMES), 0
        for frame in range(len(levels)):
            now_s = (frame + 1) / (FRAMES * series.RATE_HZ)
            while following < len(times_s) and times_s[following] <= now_s:
                field.slip(float(times_s[following]), int(block[following]))
                following += 1
            levels[frame] = field.levels(now_s).sum() / self._shape.count
        return levels.reshape(-1, FRAMES).mean(axis=1)


def there(bag: Bag) -> bool:
    """Tell whether a bag is of a twin and has the path of its rim."""
    return recorded_settings(bag, 'twin') is not None and bag.count('truth') > 1


def of(bag: Bag) -> Uncoupled | None:
    """Return the control of a bag; None where there is none."""
    if not there(bag):
        return None
    rows = bag.gathered(RimPath).rows()
    if len(rows) < 2:
        return None
    twin = recorded_settings(bag, 'twin') or TwinSettings()
    leds = recorded_settings(bag, 'leds') or LedsSettings()
    grains = recorded_settings(bag, 'grains') or GrainsSettings()
    return Uncoupled(twin, leds, grains, rows, bag.duration_s, recorded_table(bag))
