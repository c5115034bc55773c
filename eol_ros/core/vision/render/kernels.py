# SPDX-License-Identifier: Apache-2.0
"""Inner loops of the twin's camera: covers, flashes, sensor noise, on float32 images."""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import exp

_STEPS = 4096
_ZERO = np.float32(0.0)
_REACH = 5.0  # standard deviations after which an edge is fully on or off
_PHI = np.array(
    [
        0.5 * math.erfc(-(i * 2 * _REACH / _STEPS - _REACH) / math.sqrt(2.0))
        for i in range(_STEPS + 2)
    ],
    np.float32,
)


@njit(inline='always', fastmath=True)
def _phi(x):
    """Return the normal distribution function at `x` f4, interpolated (error below 2e-7).

    It has no branch, so loops over it are vectorised.
    """
    place = (x + np.float32(_REACH)) * np.float32(_STEPS / (2 * _REACH))
    place = min(max(place, _ZERO), np.float32(_STEPS))
    i = np.uint32(np.int32(place))
    low = _PHI[i]
    return low + (_PHI[i + np.uint32(1)] - low) * (place - np.float32(i))


@njit(cache=True)
def restore(work, static, windows, n):
    """Copy `static` back into `work` where the first `n` windows are (row0, row1, col0, col1).

    They overlap: of each row all between the first and the last column is copied, once.
    """
    height, width = work.shape
    first, last = np.full(height, width), np.zeros(height, np.int64)
    for i in range(n):
        for r in range(windows[i, 0], windows[i, 1]):
            first[r] = min(first[r], windows[i, 2])
            last[r] = max(last[r], windows[i, 3])
    for r in range(height):
        if first[r] < last[r]:
            work[r, first[r] : last[r]] = static[r, first[r] : last[r]]


@njit(cache=True)
def _window(windows, i, shape, u0, u1, v0, v1):
    windows[i, 0] = min(max(int(math.floor(v0)), 0), shape[0])
    windows[i, 1] = min(max(int(math.ceil(v1)) + 1, 0), shape[0])
    windows[i, 2] = min(max(int(math.floor(u0)), 0), shape[1])
    windows[i, 3] = min(max(int(math.ceil(u1)) + 1, 0), shape[1])


@njit(cache=True, fastmath=True, error_model='numpy')
def draw_blocks(work, corners, level, psf_px, owner, weight, windows):
    """Add quadrilateral covers to `work`; return the number of dirty windows.

    A cover adds its light to the ambient light, which it sends back as the platform does. It is a
    flat quadrilateral seen through a Gaussian of `psf_px` and a square pixel. The pixel's box adds
    its variance 1/12 to the Gaussian's: exact to the third moment along every direction, so edges
    stay where they are at any angle and any sub-pixel place.

    corners (p, 4, 2) px in turn round the square, one entry for each position that a block takes
    during the exposure; owner (p,) its block, weight (p,) its share of the exposure; level (k,) of
    each block.
    """
    nx = np.empty(4)
    ny = np.empty(4)
    at = np.empty(4)  # distance from each side, inwards: at the row's first pixel
    inwards = np.empty(4)  # of the centre
    cover = np.empty(work.shape[1], np.float32)
    blur = math.sqrt(psf_px * psf_px + 1.0 / 12.0)
    for p in range(corners.shape[0]):
        cu, cv = placed(work, corners[p], blur, nx, ny, inwards, windows, p)
        r0, r1, c0, c1 = windows[p]
        light = np.float32(weight[p]) * np.float32(level[owner[p]])
        for r in range(r0, r1):
            for k in range(4):
                at[k] = inwards[k] + nx[k] * (c0 - cu) + ny[k] * (r - cv)
            begin, end = covered(cover, nx, at, blur, c1 - c0)
            row = work[r, c0 + begin : c0 + end]
            for i in range(end - begin):
                row[i] += light * cover[i]
    return corners.shape[0]


@njit(inline='always', fastmath=True)
def placed(work, corners, blur, nx, ny, inwards, windows, n):
    """Write window `n` of a cover, the normals of its sides and their distances to its centre.

    Return the centre (px).
    """
    cu = cv = 0.0
    for k in range(4):
        cu += corners[k, 0] / 4
        cv += corners[k, 1] / 4
    reach = 0.0
    for k in range(4):
        ax, ay = corners[k, 0], corners[k, 1]
        ex, ey = corners[(k + 1) % 4, 0] - ax, corners[(k + 1) % 4, 1] - ay
        length = math.sqrt(ex * ex + ey * ey)
        nu, nv = -ey / length, ex / length
        inwards[k] = (cu - ax) * nu + (cv - ay) * nv
        if inwards[k] < 0:
            nu, nv, inwards[k] = -nu, -nv, -inwards[k]
        nx[k], ny[k] = nu, nv
        reach = max(reach, math.sqrt((ax - cu) ** 2 + (ay - cv) ** 2))
    pad = reach + 4.5 * blur
    _window(windows, n, work.shape, cu - pad, cu + pad, cv - pad, cv + pad)
    return cu, cv


@njit(inline='always', fastmath=True)
def covered(cover, nx, at, blur, width):
    """Write to `cover` (f4) the covered share of each pixel of a row; return its (begin, end).

    nx, at (4,): as in `_edges`.
    """
    far = _REACH * blur
    begin, end = _beyond(nx, at, -far, width)
    if begin >= end:
        return 0, 0
    full, edge = _beyond(nx, at, far, width)
    if full >= edge:  # no pixel of the row is wholly covered
        full = edge = end
    _edges(cover[: full - begin], nx, at, blur, begin)
    _edges(cover[edge - begin : end - begin], nx, at, blur, edge)
    inner = cover[full - begin : edge - begin]
    for i in range(len(inner)):
        inner[i] = 1.0
    return begin, end


@njit(inline='always', fastmath=True)
def _beyond(nx, at, bound, width):
    """Return the pixels, from one to before the other, that are over `bound` inside all sides."""
    begin, end = 0, width
    for k in range(4):
        if abs(nx[k]) < 1e-9:
            if at[k] <= bound:
                end = 0
        elif nx[k] > 0:
            begin = max(begin, int(math.floor(min((bound - at[k]) / nx[k], float(width)))) + 1)
        else:
            end = min(end, int(math.ceil(max((bound - at[k]) / nx[k], 0.0))))
    return begin, end


@njit(inline='always', fastmath=True)
def _edges(cover, nx, at, blur, first):
    """Write to `cover` (n,) f4 how much of the pixels from `first` on a cover covers.

    nx, at (4,): what a pixel more adds to the distance from each side, and that of pixel 0.
    """
    u0, u1 = np.float32(nx[0] / blur), np.float32(nx[1] / blur)
    u2, u3 = np.float32(nx[2] / blur), np.float32(nx[3] / blur)
    a0, a1 = np.float32(at[0] / blur) + u0 * first, np.float32(at[1] / blur) + u1 * first
    a2, a3 = np.float32(at[2] / blur) + u2 * first, np.float32(at[3] / blur) + u3 * first
    for i in range(len(cover)):
        c = np.float32(np.int32(i))
        one = _phi(np.float32(a0 + u0 * c)) + _phi(np.float32(a2 + u2 * c))
        other = _phi(np.float32(a1 + u1 * c)) + _phi(np.float32(a3 + u3 * c))
        cover[i] = (one - np.float32(1.0)) * (other - np.float32(1.0))


@njit(cache=True, fastmath=True, error_model='numpy')
def draw_halos(work, centres, halo, halo_px, windows, n):
    """Add to `work` what dust sends back of white light, Gaussians of `halo_px` round `centres`.

    centres (k, 2) px, halo (k,) grey at the centre, none where 0; return the windows.
    """
    across = np.empty(work.shape[1], work.dtype)
    for b in range(centres.shape[0]):
        if halo[b] > 0:
            cu, cv, pad = centres[b, 0], centres[b, 1], 2.7 * halo_px
            _window(windows, n, work.shape, cu - pad, cu + pad, cv - pad, cv + pad)
            r0, r1, c0, c1 = windows[n]
            n += 1
            for c in range(c1 - c0):
                across[c] = halo[b] * exp(-0.5 * ((c0 + c - cu) / halo_px) ** 2)
            for r in range(r0, r1):
                down = np.float32(exp(-0.5 * ((r - cv) / halo_px) ** 2))
                row = work[r, c0:c1]
                for c in range(c1 - c0):
                    row[c] += down * across[c]
    return n


@njit(inline='always')
def _mix(seed, image, row):
    """Return 64 well-mixed bits of three counters (splitmix64 finaliser, Steele et al. 2014)."""
    z = (
        np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15)
        + np.uint64(image) * np.uint64(0xD1B54A32D192ED03)
        + np.uint64(row) * np.uint64(0x8CB92BA72F3D8DD7)
    )
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True, fastmath=True, error_model='numpy')
def sense(work, noise, noise_step, read, gain, seed, image, out):
    """Write what an 8-bit sensor of variance read^2 + gain * signal makes of `work`.

    `noise` is a long row of int8 normal deviates of unit `noise_step`; every image row starts in
    it at a place drawn from (seed, image, row), so two images share no noise pattern.
    """
    height, width = work.shape
    span = np.uint64(len(noise) - width)
    read2 = np.float32(read * read)
    slope = np.float32(gain)
    unit = np.float32(noise_step)
    for r in range(height):
        start = np.int64(_mix(seed, image, r) % span)
        row = work[r]
        deviates = noise[start : start + width]
        line = out[r]
        for c in range(width):
            light = max(row[c], np.float32(0.0))
            seen = light + np.sqrt(read2 + slope * light) * unit * np.float32(deviates[c])
            seen = min(max(seen + np.float32(0.5), np.float32(0.0)), np.float32(255.0))
            line[c] = np.uint8(np.int32(seen))
