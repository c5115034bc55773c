# SPDX-License-Identifier: Apache-2.0
"""The edge of what the live parts are given: hands, clocks, sample rates, triggers, cameras.

Each function makes one case and returns its row: what was asked, status, error against what, time.
"""

import dataclasses
import time

import numpy as np
from support.paper import rest_lattice
from support.sound_reference import reference, score, snr_db

from eol_ros.core.physics.twin.hands import Frame, keep_within
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import render_all
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration import calibrate
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

RATE_HZ = 60
FLOOD = 1_000_000
FAST = (100.0, -100.0, 50.0)  # m/s, m/s, rad/s: what no hand does
NO_NUMBERS = (np.nan, np.inf, -np.inf)


def wild_hands(seconds: float = 10.0) -> dict:
    """Four hands ask for 100 m/s each its own way, and each second one sends NaN and infinity."""
    play = Play(1)
    rng = np.random.default_rng(4)
    off, begin = 0.0, time.process_time()
    for _ in range(round(seconds * RATE_HZ)):
        now = play.time_s
        for hand in range(4):
            way = np.array(FAST) * rng.choice([-1.0, 1.0], 3)
            play.commands.take(now, f'hand {hand}', way, 0.2)
        play.commands.take(now, 'broken', NO_NUMBERS, 0.2)
        play.commands.take(now, 'broken too', FAST, np.nan)
        play.advance(1 / RATE_HZ)
        pose = play.rim.pose
        kept = pose.copy()
        keep_within(kept, Frame.of(play.table.table))
        off = max(off, float(np.abs(pose - kept).max()))
        if not all(np.isfinite(part).all() for part in (pose, play.table.x, play.table.velocity)):
            return _row('live twin, hands at 100 m/s and NaN', 'not finite', reached=now)
    faults = play.table.faults
    return _row(
        'live twin, hands at 100 m/s and NaN',
        'ok' if not faults else f'{faults} images met a limit: blocks stopped there',
        begin,
        seconds,
        error=f'rim {off:.1g} m off the platform, ledger {play.table.energy_residual:.1g} J',
        against='reach of the rim, energy',
        holds='the rim goes 0.35 m/s at most and a hand pulls with 60 N at most; NaN is no command',
        faults=faults,
    )


def live_day(hours: float = 24.0, step_s: float = 1 / RATE_HZ) -> dict:
    """The live clock runs for a day, and then visitors play for a minute."""
    play = Play(1)
    steps = round(hours * 3600 / step_s)
    begin = time.process_time()
    for _ in range(steps):
        play.advance(step_s, visitors=False)
    off_s = abs(play.time_s - steps * step_s)
    for _ in range(60 * RATE_HZ):
        play.advance(1 / RATE_HZ)
    table = play.table
    bad = table.faults or not np.isfinite(table.x).all() or table.slips == 0
    return _row(
        f'live clock of the twin, {hours:g} h',
        f'{table.faults} faults, {table.slips} slips' if bad else 'ok',
        begin,
        play.time_s,
        error=f'clock {off_s:.1g} s off, ledger {table.energy_residual:.1g} J',
        against='count of steps, energy',
        holds=f'{table.slips} slips in the minute after it',
    )


def sample_rate(rate: int) -> dict:
    """Sixty grains at a sample rate, against the mixer in double precision by formula."""
    rng = np.random.default_rng(2)
    sounds = [rng.standard_normal(2 * rate).astype('f4') * 0.1 for _ in range(2)]
    file = rng.integers(0, 2, 40)
    first, size = rng.integers(0, 1.7 * rate, 40), rng.integers(0.05 * rate, 0.3 * rate, 40)
    bank = Bank(sounds, file, first / rate, size / rate, rate)
    triggers = score(rng, 60, 1.0, len(bank), rate=rng.uniform(0.5, 2, 60))
    mixer = Mixer(rate, governor_db=0, gain_db=-3)
    begin = time.process_time()
    out = render_all(mixer, triggers, bank, rate)
    took = time.process_time() - begin
    grains = list(zip(file, first, size, strict=True))
    wanted = reference(triggers, sounds, grains, rate, rate, 10 ** (-3 / 20), mixer.look_ahead)
    row = _row(
        f'sound at {rate} Hz',
        'ok' if np.isfinite(out).all() else 'not finite',
        reached=1.0,
        error=f'{snr_db(out, wanted):.0f} dB below the sound',
        against='double precision',
    )
    return row | {'ms': took * 1e3, 'snr_db': float(snr_db(out, wanted))}


def trigger_flood(triggers: int = FLOOD) -> dict:
    """So many triggers are asked of the mixer within one second."""
    rate, blocks = 48_000, 100
    rng = np.random.default_rng(3)
    sounds = [rng.standard_normal(rate).astype('f4') * 0.3]
    bank = Bank(sounds, np.zeros(40, int), rng.uniform(0, 0.6, 40), np.full(40, 0.3), rate)
    mixer = Mixer(rate)
    asked = score(rng, triggers, 1.0, len(bank))
    asked = asked[np.argsort(asked['time_s'])]
    out = []
    begin = time.process_time()
    for part in np.array_split(asked, blocks):
        mixer.play(part, bank)
        out.append(mixer.render(rate // blocks))
    took = time.process_time() - begin
    s = mixer.state[0]
    waiting = int(s['ring_head'] - s['ring_tail'])
    counted = int(s['triggers']) + int(s['dropped']) + waiting
    peak = float(np.abs(np.concatenate(out)).max())
    if counted != triggers:
        status = f'{triggers - counted} triggers are not accounted for'
    else:
        status = 'ok' if np.isfinite(peak) and peak <= 10 ** (-1 / 20) else f'peak {peak:.3g}'
    row = _row(
        f'{triggers:g} triggers in a second',
        status,
        reached=1.0,
        error=f'{triggers - counted} of them uncounted',
        against='count',
        holds=f'{int(s["triggers"])} taken, {int(s["dropped"])} dropped, {waiting} wait, '
        f'{int(s["stolen"])} voices stolen; peak {20 * np.log10(peak):.1f} dBFS',
    )
    return row | {'ms': took * 1e3}


def collinear(spread: float) -> dict:
    """Calibrate on five points, measured to 0.05 px, that leave a line by `spread` of its length.

    A status of `refused` has the words that a person gets.
    """
    camera = Calibration.ideal()
    along = np.linspace(-0.6, 0.6, 5)
    across = 1.2 * spread * np.array([0.5, -0.5, 0.3, -0.5, 0.5])
    xy = np.column_stack([along, across])
    rng = np.random.default_rng(5)
    name = f'calibration from five points, {spread:g} of their length off a line'
    begin = time.process_time()
    try:
        px = camera.to_pixels(xy) + rng.normal(0, 0.05, (5, 2))
        solved = calibrate.from_points(px, xy, camera)
    except ConfigError as error:
        return _row(name, 'refused', begin, holds=str(error))
    refusal = solved.refusal()
    corners = calibrate.platform_corners(Table())
    off = solved.calibration.to_table(camera.to_pixels(corners)) - corners
    worst, told = 1e3 * float(np.hypot(*off.T).max()), float(solved.corner_mm.max())
    return _row(
        name,
        'refused' if refusal else 'ok',
        begin,
        error=f'corners {worst:.2g} mm, told {told:.2g} mm',
        against='the camera that was',
        holds=refusal,
        worst_mm=worst,
        told_mm=told,
    )


def tilted(degrees: float) -> Calibration:
    """Return the ideal camera, tilted about the table's x axis; the middle keeps its scale."""
    ideal = Calibration.ideal()
    distance = ideal.camera_matrix[0, 0] / ideal.px_per_m()
    a = np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    columns = np.column_stack([turn @ [1, 0, 0], turn @ [0, -1, 0], [0, 0, distance]])
    homography = ideal.camera_matrix @ columns
    return dataclasses.replace(ideal, homography=homography / homography[2, 2])


def steep_camera(degrees: float = 60.0, images: int = 30) -> dict:
    """The tracker follows still blocks of a rotated table, seen from the side."""
    camera = tilted(degrees)
    renderer = Renderer(RenderOptions(noise='L2'), camera, 3)
    tracker = Tracker(TrackerSettings(), camera)
    tracker.warm_up()
    rng = np.random.default_rng(6)
    xy, yaw = rest_lattice() + rng.normal(0, 0.004, (25, 2)), rng.normal(0, 0.05, 25)
    seen, left, took = 0, [], []
    for image in range(images):
        picture = renderer.render(*xy.T, yaw, image)
        begin = time.process_time()
        tracked = tracker.update(image / RATE_HZ, picture)
        took.append(time.process_time() - begin)
        if image >= images // 2:  # the first images find the lattice
            seen += int(tracked.seen.sum())
            left.append((tracked.world[:, :2] - xy)[tracked.seen])
    off = np.concatenate(left) * 1e3
    share = seen / (25 * (images - images // 2))
    rms = float(np.sqrt((off**2).mean())) if len(off) else float('nan')
    row = _row(
        f'camera tilted by {degrees:g} degrees',
        'ok' if share > 0.99 else f'{share:.0%} of the blocks are seen, the others told as unseen',
        error=f'{rms:.2g} mm RMS of those seen' if len(off) else '',
        against='the poses drawn' if len(off) else '',
        seen=share,
        rms_mm=rms,
    )
    return row | {'ms': 1e3 * float(np.median(took))}


def _row(
    case: str,
    status: str,
    begin: float | None = None,
    reached: float | None = None,
    error: str = '',
    against: str = '',
    holds: str = '',
    **more: object,
) -> dict:
    row = {'case': case, 'where': 'live', 'status': status, 'error': error, 'against': against}
    if begin is not None:
        row['ms'] = (time.process_time() - begin) * 1e3
    if reached is not None:
        row['t_reached'] = reached
    return row | {'notes': holds} | more


PARTS = {
    'hands': wild_hands,
    'clock': live_day,
    '8 kHz': lambda: sample_rate(8000),
    '192 kHz': lambda: sample_rate(192_000),
    'triggers': trigger_flood,
    'collinear 0.02': lambda: collinear(0.02),
    'collinear 0.06': lambda: collinear(0.06),
    'collinear 0.2': lambda: collinear(0.2),
    'camera 40': lambda: steep_camera(40.0),
    'camera 60': lambda: steep_camera(60.0),
}
