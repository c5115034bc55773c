# SPDX-License-Identifier: Apache-2.0
"""Arms that sweep over resting covers: what is seen to slip where nothing does, and what does.

Real tracker, real motion, at the shipped settings. Flat covers are drawn, those with relief are
path-traced; blocks rest at any of their places, and now and then one of them slides by some
millimetres, every other time one of which an arm hides a part. A START that no true slip explains
is a false one. With relief a block that slides is its image, shifted: what stands within 66 mm of
it goes along, and the table about it is drawn out as far as half way to its neighbours.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from scipy import stats
from support.clutter import draw_arms
from support.paper import N_BLOCKS
from support.relief import films

from benchmarks.vision_hard import FlatLight, HardTally, ReliefLight
from benchmarks.vision_peers import timed
from benchmarks.vision_scenes import RATE_HZ, number
from eol_ros.core.motion.motion import Motion
from eol_ros.core.motion.slips import START
from eol_ros.core.vision.render.renderer import Sensor
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import MotionSettings, TrackerSettings
from eol_ros.verbs.progress import track

LEARN_S = 2.0  # out of account, nobody reaches in: names and noise are learnt
COMES_MPS = 1.2  # at first, however slow it is then
SLIPS_A_S = 1.0
SHORTEST_M, LONGEST_M, OFFSET_M = 0.0005, 0.003, 0.003  # of slips; most that they lead off by
LASTS_S = (0.05, 0.12)
NEAR_S = 0.05  # a START is right with an onset so near to that of a true slip,
AGAIN_S = 0.25  # after an arm has left it a block counts as newly seen for so long
LATE_S = 0.4  # or so soon after half of the block is in sight: when it slid unseen nobody knows
WHOLE, HALF, HIDDEN = 0.98, 0.5, 0.02
GOES_M, STAYS_M = 0.066, 0.087  # of the centre of a block that slides: what goes along, what stays
SHADE_GREY, SHADE_PX, SHADE_M = 4.0, 12.0, 0.03  # how dark a shadow is, how soft, how far off
LIT = 0.9  # less of the light of the room is shadow
WHERE = ('hidden', 'mostly hidden', 'partly hidden', 'newly seen', 'in shadow', 'whole')


@dataclass(frozen=True)
class Arms:
    """Arms that go from place to place: mean speed of a hand, radii and grey level of all."""

    many: int = 2
    speed_mps: float = 0.6
    hand_m: float = 0.055
    arm_m: float = 0.040
    grey: tuple[float, float] = (50.0, 110.0)
    clutter: str = 'clean'  # of vision_hard; its own arms come beside


KINDS = {
    'none': Arms(0),
    'slow': Arms(speed_mps=0.15),
    'brisk': Arms(),
    'rough': Arms(speed_mps=1.5),
    'bright': Arms(grey=(110.0, 150.0)),
    'dark': Arms(grey=(15.0, 40.0)),
    'sleeves': Arms(3, hand_m=0.115, arm_m=0.115, grey=(80.0, 80.0)),
    'hard': Arms(0, clutter='hard'),
    'brutal': Arms(0, clutter='brutal'),
}


class Sweeping:
    """Capsules (k, 6), x0, y0, x1, y1, radius in m and grey, of `arms` at any time."""

    def __init__(self, arms: Arms, seconds: float, seed: int):
        self.arms, self.paths = arms, []
        for k in range(arms.many):
            rng = np.random.default_rng([seed, 21, k])
            side = rng.uniform(0, 2 * np.pi)
            shoulder = 1.25 * np.array([np.cos(side), np.sin(side)])
            times, places = [LEARN_S], [shoulder]
            while times[-1] < LEARN_S + seconds:
                places.append(rng.uniform(-0.45, 0.45, 2))
                far = math.hypot(*(places[-1] - places[-2]))
                speed = arms.speed_mps if len(times) > 1 else max(arms.speed_mps, COMES_MPS)
                times.append(times[-1] + max(far / speed, 0.05))
            self.paths.append(
                (shoulder, np.array(times), np.array(places), rng.uniform(*arms.grey))
            )

    def at(self, time_s: float) -> np.ndarray:
        """Return them at `time_s`."""
        found = []
        for shoulder, times, places, grey in self.paths:
            if time_s < times[0]:
                continue
            i = min(int(np.searchsorted(times, time_s, 'right')) - 1, len(times) - 2)
            phase = min((time_s - times[i]) / (times[i + 1] - times[i]), 1.0)
            phase = 0.5 - 0.5 * math.cos(math.pi * phase)
            hand = places[i] + phase * (places[i + 1] - places[i])
            away = shoulder - hand
            wrist = hand + 0.10 * away / max(math.hypot(*away), 0.1)
            found.append([*shoulder, *wrist, self.arms.arm_m, grey])
            found.append([*wrist, *hand, self.arms.hand_m, 1.1 * grey])
        return np.reshape(found, (-1, 6))


@dataclass
class Slip:
    """A true slip; `told_s`: the stamp of its START, `seen_s`: when half of it was in sight."""

    block: int
    onset_s: float
    lasts_s: float
    by_m: np.ndarray
    share: float  # of the block in sight as it began
    seen_s: float = np.inf
    told_s: float = np.inf
    told: int = 0  # number of the slip that tells it
    distance_m: float = np.nan  # by its STOP


class Slides:
    """Blocks that slide now and then, by half a cosine."""

    def __init__(self, seconds: float, seed: int):
        self.rng = np.random.default_rng([seed, 22])
        self.from_s, self.until_s = LEARN_S, LEARN_S + seconds - LATE_S
        self.rest = np.zeros((N_BLOCKS, 2))
        self.slips: list[Slip] = []
        self.running: list[Slip] = []

    def go_on(self, time_s: float, shares: np.ndarray) -> None:
        """Begin what begins between `time_s` and the next image; shares (25,) in sight now."""
        for slip in [s for s in self.running if time_s > s.onset_s + s.lasts_s]:
            self.rest[slip.block] += slip.by_m
            self.running.remove(slip)
        chance = self.rng.random() < SLIPS_A_S / RATE_HZ
        if not (chance and self.from_s < time_s < self.until_s):
            return
        lately = {s.block for s in self.slips if s.onset_s > time_s - 1.0}
        free = np.array([b not in lately for b in range(N_BLOCKS)])
        partly = free & (shares > HIDDEN) & (shares < WHOLE)
        if self.rng.random() < 0.5 and partly.any():
            free = partly
        block = int(self.rng.choice(np.flatnonzero(free)))
        way, rng = self.rng.uniform(0, 2 * np.pi), self.rng
        by = rng.uniform(SHORTEST_M, LONGEST_M) * np.array([np.cos(way), np.sin(way)])
        if np.hypot(*(self.rest[block] + by)) > OFFSET_M:
            by *= -1.0 if np.hypot(*(self.rest[block] - by)) < OFFSET_M else 0.3
        onset_s = time_s + rng.uniform(0, 1 / RATE_HZ)
        slip = Slip(block, onset_s, rng.uniform(*LASTS_S), by, float(shares[block]))
        self.slips.append(slip)
        self.running.append(slip)

    def at(self, time_s: float) -> np.ndarray:
        """Return how far (25, 2) m blocks have slid."""
        off = self.rest.copy()
        for s in self.running:
            phase = min(max((time_s - s.onset_s) / s.lasts_s, 0.0), 1.0)
            off[s.block] += s.by_m * (0.5 - 0.5 * math.cos(math.pi * phase))
        return off


class FlatAtRest(FlatLight):
    """Drawn covers that rest but for slides."""

    def __init__(self, level: str, seed: int, slides: Slides):
        super().__init__(level, seed)
        poses = np.column_stack([self.film.rest, self.film.yaw])
        self.film.pose = lambda time_s: poses + np.pad(slides.at(time_s), ((0, 0), (0, 1)))


class ReliefAtRest(ReliefLight):
    """Path-traced covers that rest but for slides."""

    def __init__(self, level: str, seed: int, slides: Slides):
        super().__init__(level, seed)
        self.slides, self.still, self.home = slides, self.light, self.pose
        self.slid = np.zeros((N_BLOCKS, 2))

    def at(self, index: int, more: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return light (h, w), poses (25, 3), and shares in sight (25,)."""
        off = self.slides.at(index / RATE_HZ)
        if (off != self.slid).any():
            self.pose = self.home + np.pad(off, ((0, 0), (0, 1)))
            self.light, self.slid = self.still.copy(), off
            for block in np.flatnonzero(off.any(axis=1)).tolist():
                self._shift(block)
        return super().at(index, more)

    def _shift(self, block: int) -> None:
        old, new = self.camera.to_pixels(np.stack([self.home[block, :2], self.pose[block, :2]]))
        per_m = self.camera.px_per_m()
        reach = int(STAYS_M * per_m) + 2
        u0, v0 = (np.rint(old).astype(int) - reach).tolist()
        window = slice(v0, v0 + 2 * reach + 1), slice(u0, u0 + 2 * reach + 1)
        v, u = np.mgrid[window].astype(np.float32)
        goes, stays = GOES_M * per_m, STAYS_M * per_m
        share = np.clip((stays - np.hypot(u - new[0], v - new[1])) / (stays - goes), 0.0, 1.0)
        at = [c - (share * d).astype(np.float32) for c, d in zip((u, v), new - old, strict=True)]
        shifted = cv2.remap(self.still, *at, cv2.INTER_CUBIC)
        self.light[window] = np.where(share > 0, shifted, self.light[window])


def _shade(camera: Any, light: np.ndarray, capsules: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `light` with what arms take of the light of the room, and how much is left, 0..1."""
    left = np.ones(light.shape, np.float32)
    if not len(capsules):
        return light.copy(), left
    ends = camera.to_pixels((capsules[:, :4] + SHADE_M).reshape(-1, 2)).reshape(-1, 4)
    arms = np.hstack([ends, capsules[:, 4:5] * camera.px_per_m()])
    draw_arms(
        left, left.copy(), arms, np.zeros(len(arms)), SHADE_PX, np.zeros((64, 4), np.int64), 0
    )
    return np.maximum(light - SHADE_GREY * (1.0 - left), 0.0), left


@dataclass
class ArmsTally(HardTally):
    """What motion makes of all videos of a kind, beside what the tracker sees."""

    slips: list[Slip] = field(default_factory=list)
    wrong: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0
    off: list[np.ndarray] = field(default_factory=list)  # sigmas, of blocks partly hidden

    def figures(self) -> dict:
        """Return the figures of a row."""
        hours = self.seconds / 3600
        low, high = poisson(len(self.wrong))
        off = np.concatenate(self.off) if self.off else np.zeros(0)
        told = [s for s in self.slips if np.isfinite(s.told_s)]
        more: dict[str, Any] = {
            'hours': hours,
            'false_slips': len(self.wrong),
            'false_an_hour': len(self.wrong) / hours,
            'false_an_hour_95': [low / hours, high / hours],
            'where': {w: sum(one['where'] == w for one in self.wrong) for w in WHERE},
            'beyond_5_sigma': float((off > 5.0).mean()) if len(off) else None,
            'wrong': self.wrong,
        }
        for name, low_share, high_share in (
            ('whole', WHOLE, 2.0), ('partly', HALF, WHOLE), ('mostly hidden', HIDDEN, HALF),
        ):  # fmt: skip
            those = [s for s in self.slips if low_share <= s.share < high_share]
            found = [s for s in those if np.isfinite(s.told_s)]
            late = [(s.told_s - s.onset_s) * RATE_HZ for s in found]
            size = [s.distance_m - np.hypot(*s.by_m) for s in found if np.isfinite(s.distance_m)]
            more[f'true_{name}'] = {
                'slips': len(those),
                'found': len(found),
                'latency_images': np.quantile(late, [0.5, 0.95]).tolist() if late else None,
                'size_error_mm': float(np.sqrt(np.mean(np.square(size)))) * 1e3 if size else None,
            }
        more['found'] = len(told) / len(self.slips) if self.slips else None
        return super().figures() | more


class Scene:
    """One place under one kind of arms: images with their truth, no tracker."""

    def __init__(self, surface: str, kind: str, seconds: float, seed: int):
        arms = KINDS[kind]
        self.name, self.seed = f'{surface} {kind} {seed}', seed
        self.count = round((LEARN_S + seconds) * RATE_HZ)
        self.slides, self.sweeping = Slides(seconds, seed), Sweeping(arms, seconds, seed)
        rest = FlatAtRest if surface == 'flat' else ReliefAtRest
        self.source = rest(arms.clutter, seed, self.slides)
        self.camera = self.source.camera
        self.home = self.source.at(0, np.zeros((0, 6)))[1]

    def images(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Yield image, poses (25, 3), shares in sight (25,), and how much of the room's light is
        left there (25,)."""
        camera, sensor = self.camera, Sensor(*films.NOISE, (self.seed, 0))
        image = np.empty((camera.image_height, camera.image_width), np.uint8)
        reach = int(0.06 * camera.px_per_m())
        middle = np.rint(camera.to_pixels(self.home[:, :2])).astype(int)
        for k in range(self.count):
            capsules = self.sweeping.at(k / RATE_HZ)
            light, pose, shares = self.source.at(k, capsules)
            light, left = _shade(camera, light, capsules)
            sensor.sense(light, k, image)
            least = [
                left[v - reach : v + reach, u - reach : u + reach].min() for u, v in middle.tolist()
            ]
            yield image, pose, shares, np.array(least)
            self.slides.go_on(k / RATE_HZ, shares)


def follow(scene: Scene, tally: ArmsTally) -> Iterator[None]:
    """Add to `tally` what tracker and motion make of a scene, image by image."""
    camera, slips = scene.camera, scene.slides.slips
    motion, tracker = Motion(MotionSettings()), Tracker(TrackerSettings(), camera)
    off = np.full((scene.count, N_BLOCKS, 2), np.nan)
    sigma, share = np.full((2, scene.count, N_BLOCKS), np.nan)
    for k, (image, pose, shares, left) in enumerate(scene.images()):
        stamp_s = k / RATE_HZ
        tracked, ms = timed(tracker.update, stamp_s, image)
        seen, share[k], sigma[k] = tracked.seen, shares, tracked.sigma_m
        off[k, seen] = (tracked.world - pose[:, :2])[seen]
        for slip in slips:
            if np.isinf(slip.seen_s) and shares[slip.block] > HALF:
                slip.seen_s = stamp_s
        found, _ = motion.update(stamp_s, *tracked.world.T, seen, tracked.sigma_m)
        if stamp_s >= LEARN_S:
            tally.add(ms, off[k] * camera.px_per_m(), shares, 0)
        for event in (one.event for one in found):
            if event.kind != START:
                for slip in slips:
                    if slip.told == event.slip:
                        slip.distance_m = event.distance_m
            elif not _explained(event, slips) and stamp_s >= LEARN_S:
                lately = share[max(k - round(AGAIN_S * RATE_HZ), 0) : k, event.block]
                where = _where(shares[event.block], lately, left[event.block])
                tally.wrong.append(
                    {'video': scene.name, 'image': k, 'block': event.block, 'where': where}
                )
        yield
    tally.slips += slips
    tally.seconds += (scene.count - 1) / RATE_HZ - LEARN_S
    usual = np.nanmedian(np.where(share[..., None] > WHOLE, off, np.nan), axis=0)
    away = np.hypot(*np.moveaxis(off - usual, -1, 0)) / sigma
    partly = (share > HALF) & (share < WHOLE) & np.isfinite(away)
    partly[: round(LEARN_S * RATE_HZ)] = False
    tally.off.append(away[partly])


def _explained(event: Any, slips: list[Slip]) -> bool:
    """Return whether a START tells one of the true `slips`, which is then told."""
    for slip in reversed(slips):
        if slip.block == event.block and np.isinf(slip.told_s) and event.stamp_s > slip.onset_s:
            near = abs(event.onset_s - slip.onset_s) < NEAR_S
            if near or event.stamp_s < slip.seen_s + LATE_S:
                slip.told_s, slip.told = event.stamp_s, event.slip
                return True
    return False


def _where(share: float, lately: np.ndarray, left: float) -> str:
    if share < WHOLE:
        return 'hidden' if share < HIDDEN else 'mostly hidden' if share < HALF else 'partly hidden'
    if lately.min(initial=1.0) < WHOLE:
        return 'newly seen'
    return 'in shadow' if left < LIT else 'whole'


def poisson(count: int) -> tuple[float, float]:
    """Return the 95 % interval of the mean of a count (Garwood 1936)."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return float(low), float(stats.chi2.ppf(0.975, 2 * count + 2) / 2)


def measure(
    kinds: list[str], surfaces: list[str], seconds: float, seeds: int, first_seed: int
) -> dict:
    """Return figures of each surface and kind, all videos of it together."""
    jobs = [(s, k, first_seed + i) for s in surfaces for k in kinds for i in range(seeds)]
    images = len(jobs) * round((LEARN_S + seconds) * RATE_HZ)
    joint: dict[str, dict[str, ArmsTally]] = {s: {k: ArmsTally() for k in kinds} for s in surfaces}
    steps = (step for s, k, i in jobs for step in follow(Scene(s, k, seconds, i), joint[s][k]))
    for _ in track(steps, 'arms', images):
        pass
    return {'arms': {s: {k: t.figures() for k, t in of.items()} for s, of in joint.items()}}


def table(result: dict) -> str:
    """Return the figures as lines of text."""
    lines = []
    for surface, kinds in result['arms'].items():
        for kind, f in kinds.items():
            low, high = f['false_an_hour_95']
            where = ', '.join(f'{n} {w}' for w, n in f['where'].items() if n) or 'none'
            lines.append(
                f'{surface:6s} {kind:8s} {f["false_slips"]} false slips in'
                f' {f["hours"] * 3600:.0f} s: {f["false_an_hour"]:.0f} an hour'
                f' (95 %: {low:.0f} to {high:.0f}): {where}'
            )
            for name in ('whole', 'partly', 'mostly hidden'):
                t = f[f'true_{name}']
                if t['slips']:
                    late = t['latency_images'] or [np.nan, np.nan]
                    lines.append(
                        f'    true slips, {name}: {t["found"]} of {t["slips"]} found, after'
                        f' {late[0]:.1f} images (95 %: {late[1]:.1f}), size to'
                        f' {number(t["size_error_mm"], 3)} mm'
                    )
            lines.append(
                f'    whole {number(f["rms_px"], 3)} px {number(f["coverage"], 5)}; partly'
                f' {number(f["rms_partly_px"], 3)} px {number(f["coverage_partly"], 3)} of'
                f' {f["partly"]}, {f["partly_beyond_2px"]} beyond 2 px, worst'
                f' {number(f["partly_worst_px"], 2)}, {number(f["beyond_5_sigma"], 4)} beyond 5'
                f' sigma; hidden {f["hidden_reported"]}/{f["hidden"]}; {f["ms_median"]:.2f} ms p99'
                f' {f["ms_p99"]:.2f}'
            )
    return '\n'.join(lines)
