# SPDX-License-Identifier: Apache-2.0
"""Where the sides of a lit cover stand: its light falls towards them, so they seem further inside.

A blurred step that is fitted to the light at a side lies 0.35 to 0.48 px inside of it, as the light
falls less or more; one beside which the light falls in a straight line lies 0.1 px inside to none,
for light falls the steeper, the nearer it is to the side. Between the two, SHARE of the way, lies a
place that is INSIDE_PX inside, whatever the relief and the camera. So the known size of covers
tells the scale of an image, which their lattice alone does not: blocks rest 4 mm beside it.

Measured on ten path-traced images that no calibration is judged by (`benchmarks/relief/films`):
cameras straight, aside and leaning, with a lens and without, covers of 0, 26 and 40 mm of relief.
No real table was measured.
"""

import numpy as np
from scipy.special import erf

SHARE = 0.55
INSIDE_PX = 0.25
# And further out where a wall is in sight, which shines on the sandpaper; more than of the sides
# that a tracker reads (outline.GLOW_PX), as this reads what lies nearer to a side.
GLOW_PX = np.float32(0.27)
# What is left of it, of all sides together, in images of eight landscapes whose blur is known.
# Other plastic, walls and boards add 0.02 px by profiles of light; a tenth of blur adds 0.07 px.
SIGMA_PX = 0.015
FALL_PX = 0.2  # between the two steps, median of all sides: less than any lit cover shows. Where
# light falls less (covers that the twin draws shine evenly), sides are less far inside.
SIDE_PX = 45.5  # of covers in these images. In others (by profiles of the same light, scaled):
_INSIDE_POWER = -2 / 3  # more, the fewer pixels the same fall of light has
BIN_PX = 0.2
REACH_PX = 6.0
BINS = round(2 * REACH_PX / BIN_PX)
_FLAT = (-2.4, 2.4)  # blurs from the side, of the pixels to which a step is fitted
_RAMP = (-4.0, 3.2)  # and one beside which light falls
_ROUNDS = 3  # of placing these windows
_STEPS = 5


def side_sigma(side_px: float) -> float:
    """Return how well the length of sides of `side_px` is known, as a share, of all together."""
    return 2 * SIGMA_PX * SIDE_PX / side_px**2


def edges(seen: np.ndarray, blur_px: float, side_px: float) -> np.ndarray:
    """Return how far outside (...) px of lines the sides stand of covers `side_px` wide.

    seen (..., BINS, 3): of all pixels that lie so far outside of a line, from -REACH_PX on by
    BIN_PX, how many they are, and the sums of their distances and of their light.
    """
    shape = seen.shape[:-2]
    seen = seen.reshape(-1, *seen.shape[-2:])
    at = np.zeros(len(seen))
    inside = INSIDE_PX * (side_px / SIDE_PX) ** _INSIDE_POWER
    for _ in range(_ROUNDS):
        step = _fitted(seen, at, blur_px, _FLAT, False)
        ramp = _fitted(seen, at, blur_px, _RAMP, True)
        fall = float(np.median(ramp - step))
        at = step + SHARE * (ramp - step) + inside * min(max(fall / FALL_PX, 0.0), 1.0)
    return at.reshape(shape)


def _fitted(
    seen: np.ndarray, at: np.ndarray, blur_px: float, window: tuple[float, float], falls: bool
) -> np.ndarray:
    """Return where (n,) a blurred step lies in the light about `at`; `falls`: beside which it does.

    By Gauss-Newton, of the least squares over all pixels.
    """
    n = np.maximum(seen[..., 0], 1.0)
    d, light = seen[..., 1] / n - at[:, None], seen[..., 2] / n
    weight = np.where((d > window[0] * blur_px) & (d < window[1] * blur_px), seen[..., 0], 0.0)
    known = 3 if falls else 2
    edge, levels = np.zeros(len(d)), np.zeros((len(d), 3))  # outside, step, fall a px
    for k in range(_STEPS):
        x = (edge[:, None] - d) / blur_px
        bell = np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi)
        cover = 0.5 + 0.5 * erf(x / np.sqrt(2))
        slopes = np.stack([np.ones_like(x), cover, blur_px * (x * cover + bell)], axis=-1)
        left = light - (slopes @ levels[..., None])[..., 0]
        slopes = slopes[..., :known]
        if k:
            slant = levels[:, 1, None] * bell / blur_px + levels[:, 2, None] * cover
            slopes = np.concatenate([slopes, slant[..., None]], axis=-1)
        turned = np.swapaxes(slopes * weight[..., None], 1, 2)
        normal = turned @ slopes + 1e-9 * np.eye(slopes.shape[-1])
        change = np.linalg.solve(normal, turned @ left[..., None])[..., 0]
        levels[:, :known] += change[:, :known]
        if k:
            edge += np.clip(change[:, known], -0.5, 0.5)
    return at + edge
