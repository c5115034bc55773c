# SPDX-License-Identifier: Apache-2.0
"""Where the sides of a lit cover stand: its light falls towards them, so they seem further inside.

A blurred step that is fitted to the light at a side lies 0.35 to 0.48 px inside of it, as the light
falls less or more; one beside which the light falls in a straight line lies 0.1 px inside to none,
for light falls the steeper, the nearer it is to the side. Between the two, SHARE of the way, lies a
place that is INSIDE blurs inside, whatever the relief and the camera. So the known size of covers
tells the scale of an image, which their lattice alone does not: blocks rest 4 mm beside it.

How much a lens blurs is fitted to all sides together: a tenth more, and they seem 0.07 px further
outside, which is 0.3 % of a length.

Measured on ten path-traced images that no calibration is judged by (`test/support/relief/films`):
cameras straight, aside and leaning, with a lens and without, covers of 0, 26 and 40 mm of relief;
and on eight of these with lenses of 0.85 to 1.92 px. No real table was measured.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit

SHARE = 0.55
INSIDE = 0.2
# And further out where a wall is in sight, which shines on the sandpaper; more than of the sides
# that a tracker reads (outline.SHINE_PX), as this reads what lies nearer to a side.
NEAR_SHINE_PX = np.float32(0.27)
# What is left of it, of all sides together, in images of eight landscapes. Other plastic, walls and
# boards add 0.02 px by profiles of light.
SIGMA_PX = 0.015
FALL_PX = 0.2  # between the two steps, median of all sides: less than any lit cover shows. Where
# light falls less (covers that the twin draws shine evenly), sides are less far inside.
SIDE_PX = 45.5  # of covers in these images. In others (by profiles of the same light, scaled):
_INSIDE_POWER = -2 / 3  # more, the fewer pixels the same fall of light has
BLUR_SEEN = 1.053  # of a lens, as light falls: 1.05 to 1.06 of blurs up to 1.6 px, 1.10 of 1.92
BLUR_SIGMA = 0.04  # how well that is told: twice its scatter between landscapes
BIN_PX = 0.2
REACH_PX = 6.0
BINS = round(2 * REACH_PX / BIN_PX)
_FLAT = (-2.4, 2.4)  # blurs from the side, of the pixels to which a step is fitted
_RAMP = (-4.0, 3.2)  # and one beside which light falls
_BLUR = (-4.0, 4.0)  # and one of which the blur is not known
_ROUNDS = 3  # of placing these windows
_STEPS = 5
_BLUR_STEPS = 12


def side_sigma(side_px: float) -> float:
    """Return how well the length of sides of `side_px` is known, as a share, of all together."""
    return 2 * SIGMA_PX * SIDE_PX / side_px**2


def edges(seen: np.ndarray, blur_px: float, side_px: float) -> np.ndarray:
    """Return how far outside (...) px of lines the sides stand of covers `side_px` wide.

    seen (..., BINS, 3): of all pixels that lie so far outside of a line, from -REACH_PX on by
    BIN_PX, how many they are, and the sums of their distances and of their light. blur_px: about.
    """
    shape = seen.shape[:-2]
    seen = seen.reshape(-1, *seen.shape[-2:])
    at = np.zeros(len(seen))
    falls, about_px = 1.0, blur_px
    for n in range(_ROUNDS):
        if n < 2:  # then it is known whether light falls at all
            blur_px = blurred(seen, about_px, falls)
        step = _fitted(seen, at, blur_px, _FLAT, False)[0]
        ramp = _fitted(seen, at, blur_px, _RAMP, True)[0]
        falls = min(max(float(np.median(ramp - step)) / FALL_PX, 0.0), 1.0)
        inside = INSIDE * blur_px * (side_px / SIDE_PX) ** _INSIDE_POWER
        at = step + SHARE * (ramp - step) + inside * falls
    return at.reshape(shape)


def blurred(seen: np.ndarray, blur_px: float, falls: float) -> float:
    """Return the blur in px of a lens by what is seen (n, BINS, 3) at sides.

    falls: 1 where light falls towards them as in lit covers, down to 0 where it does not. Of what
    it differs from `blur_px` less is believed, the less it exceeds what may be an error.
    """
    told = _fitted(seen, np.zeros(len(seen)), blur_px, _BLUR, True, _BLUR_STEPS)[2]
    told /= 1 + falls * (BLUR_SEEN - 1)
    far = told / blur_px - 1
    return blur_px * (1 + far**3 / (far**2 + BLUR_SIGMA**2))


def steps(seen: np.ndarray, blur_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where (...) blurred steps stand in the light (..., BINS, 3) of `edges`, px outside.

    And the levels (..., 3): outside, and of the step.
    """
    near = math.ceil(_FLAT[1] * blur_px / BIN_PX)  # bins; no other has a weight
    flat = seen[..., BINS // 2 - near : BINS // 2 + near, :].reshape(-1, 2 * near, 3)
    at, levels, _ = _fitted(flat, np.zeros(len(flat)), blur_px, _FLAT, False)
    return at.reshape(seen.shape[:-2]), levels.reshape(*seen.shape[:-2], -1)


@njit(cache=True)
def _below(x):
    """Return the standard normal distribution at x (n,)."""
    found = np.empty_like(x)
    for k in range(len(x)):
        found[k] = 0.5 + 0.5 * math.erf(x[k] / math.sqrt(2.0))
    return found


def _fitted(
    seen: np.ndarray,
    at: np.ndarray,
    blur_px: float,
    window: tuple[float, float],
    falls: bool,
    blur_steps: int = 0,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return where (n,) a blurred step lies in the light about `at`; `falls`: beside which it does.

    And its levels (n, 3): outside, step, fall a px; and its blur, which is fitted to all sides
    together where `blur_steps` are allowed for it. By Gauss-Newton, of the least squares over all
    pixels, in shares of each side's step.
    """
    n = np.maximum(seen[..., 0], 1.0)
    d, light = seen[..., 1] / n - at[:, None], seen[..., 2] / n
    weight = np.where((d > window[0] * blur_px) & (d < window[1] * blur_px), seen[..., 0], 0.0)
    known = 3 if falls else 2
    edge, levels = np.zeros(len(d)), np.zeros((len(d), 3))  # outside, step, fall a px
    for k in range(blur_steps or _STEPS):
        x = (edge[:, None] - d) / blur_px
        bell = np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi)
        cover = _below(x.ravel()).reshape(x.shape)
        slopes = np.stack([np.ones_like(x), cover, blur_px * (x * cover + bell)], axis=-1)
        left = (light - (slopes @ levels[..., None])[..., 0])[..., None]
        slopes = slopes[..., :known]
        if k:
            slant = levels[:, 1, None] * bell / blur_px + levels[:, 2, None] * cover
            slopes = np.concatenate([slopes, slant[..., None]], axis=-1)
        turned = np.swapaxes(slopes * weight[..., None], 1, 2)
        normal = turned @ slopes + 1e-9 * np.eye(slopes.shape[-1])
        change = np.linalg.solve(normal, turned @ left)
        if k and blur_steps:
            share = np.maximum(levels[:, 1], 1.0)[:, None, None] ** -2
            wider = (levels[:, 2, None] - levels[:, 1, None] * x / blur_px) * bell
            cross = turned @ wider[..., None]
            taken = np.linalg.solve(normal, cross)  # of it by each side's own numbers
            pull = (share * (weight * wider)[:, None] @ (left - slopes @ change)).sum()
            stiff = (share * (weight * wider)[:, None] @ (wider[..., None] - slopes @ taken)).sum()
            more = float(np.clip(pull / stiff, -0.2, 0.2))
            change -= taken * more
            blur_px += more
        levels[:, :known] += change[:, :known, 0]
        if k:
            edge += np.clip(change[:, known, 0], -0.5, 0.5)
    return at + edge, levels, blur_px
