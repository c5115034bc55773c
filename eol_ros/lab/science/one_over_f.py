# SPDX-License-Identifier: Apache-2.0
"""Is a series 1/f? A verdict that needs all: slope, straightness, no rhythm, steadiness, controls.

What is said to be 1/f in music is the spectrum of the *power* of the sound below some 10 Hz (Voss
and Clarke, Nature 258 (1975) 317), not that of the waveform. `ask` answers

no         where something speaks against it: the interval of the slope lies outside 0.5 .. 1.5, a
           bending shape fits better, the bins scatter too widely about the line, a rhythm stands
           out, or a control, which knows nothing of the order of events, has the slope too;
yes        where the interval lies within 0.5 .. 1.5 over at least two decades, one Lorentzian
           and sums of two and three are excluded, and neither rhythm, unsteadiness nor any
           control explains it;
undecided  where the series is too short or too uneven for either.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from eol_ros.lab.science import spectra, surrogates
from eol_ros.lab.science.spectra import Shape, Slope, Spectrum

ONE_OVER_F = (0.5, 1.5)
DECADES = 2.0  # of the band, at least
MOST_DECADES = 4.0  # over three decades three Lorentzians pass for 1/f
BENDS = 6.0  # of AIC, by which a bending shape must be better; by chance in 3 of 100 (see test)
EXCLUDED = ('Lorentzian', 'two Lorentzians', 'three Lorentzians')
WORSE = 10.0  # of AIC, by which each of these must be
MISFIT = 0.01
UNEVEN = 0.025  # one of 39 surrogates and the series itself
FEWEST_EVENTS = 50
DRIVE_PERIODS = 10  # of the longest gestures in a series that has a verdict
GESTURE_S = 25.0  # longest period of visitors: spectra of the table bend near 0.04 Hz
STRAIGHT = ('white', 'power law')


@dataclass(frozen=True)
class Answer:
    """What was found of one series; `sentence` says it for people.

    answer: yes, no or undecided. `against` speaks against 1/f, `doubts` is what a yes still lacks.
    """

    name: str
    answer: str
    against: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    spectrum: Spectrum | None = None
    slope: Slope | None = None
    halves: tuple[Slope, Slope] | None = None
    shapes: dict[str, Shape] = field(default_factory=dict)
    rhythm: tuple[float, float] | None = None
    controls: dict[str, tuple[float, float]] = field(default_factory=dict)
    stationary_p: float | None = None

    @property
    def sentence(self) -> str:
        """The verdict, how sure it is, and what is missing."""
        if self.spectrum is None or self.slope is None:
            return f'{self.name}: 1/f is undecided: {"; ".join(self.doubts)}'
        s, band = self.slope, self.spectrum
        words = {'yes': '1/f', 'no': 'not 1/f', 'undecided': 'undecided whether 1/f'}[self.answer]
        text = (
            f'{self.name}: {words} from {band.low_hz:.3g} to {band.high_hz:.3g} Hz '
            f'({band.decades:.1f} decades): slope {s.beta:.2f} ({s.low:.2f} to {s.high:.2f})'
        )
        if self.answer == 'no':
            return f'{text}; {"; ".join(self.against)}'
        if self.answer == 'undecided':
            return f'{text}; {"; ".join(self.doubts)}'
        worse = min(self.shapes[name].aic for name in EXCLUDED) - self.shapes['power law'].aic
        text += f', straight (Lorentzians are worse by {worse:.0f} of AIC), no rhythm, steady'
        if not self.controls:
            return f'{text}; it never rests, so events at other times are no control'
        highest = ', '.join(f'{kind} {high:.2f}' for kind, (_, high) in self.controls.items())
        return f'{text}; slope of the controls at most: {highest}'


@dataclass(frozen=True)
class Series:
    """Values (n,) at `rate_hz` that are examined up to `high_hz` and four decades down.

    window_s: each value is a mean over so long. drive_s: the longest period of what drives the
    series; shorter than ten of these, it has no verdict, for the band ends where the drive bends
    it. times_s: the events that the values count, from their beginning. rest: the level at and
    below which a series that is no count rests.
    """

    name: str
    values: np.ndarray
    rate_hz: float
    high_hz: float
    window_s: float = 0.0
    drive_s: float = 0.0
    times_s: np.ndarray | None = None
    rest: float | None = None

    @property
    def duration_s(self) -> float:
        """How long it is."""
        return len(self.values) / self.rate_hz

    @property
    def low_hz(self) -> float:
        """The lower end of the band."""
        lowest_hz = spectra.PERIODS / self.duration_s if len(self.values) else np.inf
        return max(lowest_hz, self.high_hz / 10**MOST_DECADES)

    @property
    def lacks(self) -> str:
        """Why no verdict is possible on a series so short; empty where one is."""
        duration_s, low_hz = self.duration_s, self.low_hz
        if low_hz * 10**DECADES > self.high_hz * (1 + 1e-9):
            needed_s = spectra.PERIODS * 10**DECADES / self.high_hz
            return (
                f'{duration_s:.0f} s are too short: two decades below {self.high_hz:g} Hz need '
                f'{needed_s:.0f} s'
            )
        if duration_s < DRIVE_PERIODS * self.drive_s * (1 - 1e-9):
            return (
                f'{duration_s:.0f} s are too short: {DRIVE_PERIODS} of the longest gestures '
                f'({self.drive_s:g} s) need {DRIVE_PERIODS * self.drive_s:.0f} s'
            )
        if self.times_s is not None and len(self.times_s) < FEWEST_EVENTS:
            return f'{len(self.times_s)} events are too few: {FEWEST_EVENTS} are needed'
        return ''

    def spectrum(self, values: np.ndarray) -> Spectrum:
        """Return the spectrum of `values` in its band; raise SeriesError where there is none."""
        return spectra.spectrum(values, self.rate_hz, self.low_hz, self.high_hz, self.window_s)


Others = Mapping[str, Callable[[], np.ndarray]]


def ask(series: Series, rng: np.random.Generator, others: Others | None = None) -> Answer:
    """Return the verdict on a series.

    others: further controls by name, each made only when it is needed; one that is shorter than
    this series is tested over its own band.
    """
    if series.lacks:
        return Answer(series.name, 'undecided', doubts=[series.lacks])
    values = np.asarray(series.values, float)
    try:
        found = series.spectrum(values)
    except spectra.SeriesError as error:
        return Answer(series.name, 'undecided', doubts=[str(error)])
    line = spectra.slope(found)
    both = spectra.halves(found)
    shapes = spectra.shapes(found)
    rhythm = spectra.rhythm(found, line.beta)
    against = _against(line, both, shapes, rhythm)
    doubts = _doubts(line, shapes)
    controls: dict[str, tuple[float, float]] = {}
    steady = None
    if not against:  # these take long, and can only speak against it
        controls, few = _controls(series, values, rng, others or {})
        doubts += few
        for kind, (low, high) in controls.items():
            if high >= ONE_OVER_F[0]:
                against.append(f'the control ({kind}) has a slope of {low:.2f} to {high:.2f} too')
        if not against:
            steady = min(
                surrogates.stationarity(values, rng), surrogates.trend(values, line.beta, rng)
            )
        if steady is not None and steady <= UNEVEN:
            doubts.append('it is not steady: its course, not one process, makes the spectrum')
    answer = 'no' if against else 'undecided' if doubts else 'yes'
    return Answer(
        series.name, answer, against, doubts, found, line, both, shapes, rhythm, controls, steady
    )


def _controls(
    series: Series, values: np.ndarray, rng: np.random.Generator, others: Others
) -> tuple[dict[str, tuple[float, float]], list[str]]:
    """Return the least and greatest slope of each control, and what they lack."""
    times_s, rest = series.times_s, series.rest
    controls: dict[str, tuple[float, float]] = {}
    doubts = []

    def beta(made: np.ndarray) -> float:
        return spectra.slope(replace(series, values=made).spectrum(made)).beta

    if times_s is not None:
        controls = surrogates.slopes(
            lambda kind: surrogates.event_counts(
                surrogates.of_events(kind, times_s, series.duration_s, rng), series.duration_s,
                series.rate_hz,
            ),
            beta,
        )  # fmt: skip
    elif rest is not None and (values <= rest).any():
        pieces = len(surrogates.bouts(values, rest)[0])
        if pieces < FEWEST_EVENTS:
            doubts.append(f'{pieces} bouts are too few for controls: {FEWEST_EVENTS} needed')
        else:
            controls = surrogates.slopes(
                lambda kind: surrogates.of_bouts(kind, values, rest, rng), beta
            )
    for kind, make in others.items():
        try:
            slope = beta(make())
        except spectra.SeriesError:  # it does not vary: no 1/f comes from there
            slope = 0.0
        controls[kind] = (slope, slope)
    return controls, doubts


def _against(
    line: Slope,
    both: tuple[Slope, Slope],
    shapes: dict[str, Shape],
    rhythm: tuple[float, float] | None,
) -> list[str]:
    said = []
    low, high = ONE_OVER_F
    best = min(shapes.values(), key=lambda shape: shape.aic)
    if line.high < low:
        said.append('it is white' if best.name == 'white' else 'it is too flat')
    elif line.low > high:
        brown = best.name == 'power law' and line.low <= 2 <= line.high
        said.append('it is Brownian' if brown else 'it is too steep')
    if rhythm is not None:
        said.append(f'a rhythm of {rhythm[0]:.3g} Hz stands {rhythm[1]:.0f} times above the rest')
    better = shapes['power law'].aic - best.aic
    if best.name not in STRAIGHT and better >= BENDS:
        said.append(
            f'it bends, slope {both[0].beta:.2f} in the lower half and {both[1].beta:.2f} in the '
            f'upper: {best.name}: AIC lower by {better:.0f}'
        )
    if line.p_value < MISFIT and not said:
        said.append(f'it scatters too widely about the line (p {line.p_value:.1g})')
    return said


def _doubts(line: Slope, shapes: dict[str, Shape]) -> list[str]:
    said = []
    low, high = ONE_OVER_F
    if not (low <= line.low and line.high <= high):
        said.append(f'the interval does not lie within {low:g} to {high:g}')
    for name in EXCLUDED:
        if shapes[name].aic - shapes['power law'].aic < WORSE:
            said.append(f'{name} (an alternative without 1/f) not excluded')
    return said
