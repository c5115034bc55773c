# SPDX-License-Identifier: Apache-2.0
"""The springs between the rim and the blocks beside it, compiled: called for each image."""

import math

from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.physics.series import entry, inlined


@inlined
def way_to_centre(pose, c, s, u, beside, ends, centres, e):
    """Return the way from the centre of the block at spring e to the rim's end of it."""
    i = beside[e]
    x, y = ends[e].real, ends[e].imag
    return (
        pose[0] + c * x - s * y - centres[e].real - u[i, 0],
        pose[1] + s * x + c * y - centres[e].imag - u[i, 1],
    )


@entry
def pull(pose, u, yaw, beside, ends, centres, arms, stiffness, natural, force):
    """Write the force of all springs on the rim at `pose`: N, N, and N m about it."""
    c, s = cos(pose[2]), sin(pose[2])
    force[0] = force[1] = force[2] = 0.0
    for e in range(len(beside)):
        own = yaw[beside[e]]
        co, si = cos(own), sin(own)
        wx, wy = way_to_centre(pose, c, s, u, beside, ends, centres, e)
        wx -= co * arms[e].real - si * arms[e].imag
        wy -= si * arms[e].real + co * arms[e].imag
        held = -stiffness * (1.0 - natural / math.sqrt(wx * wx + wy * wy))
        fx, fy = held * wx, held * wy
        ax, ay = c * ends[e].real - s * ends[e].imag, s * ends[e].real + c * ends[e].imag
        force[0] += fx
        force[1] += fy
        force[2] += ax * fy - ay * fx


@entry
def gaps(pose, u, yaw, rotates, half, beside, ends, centres, inward, gap):
    """Write the distance (m) from the rim inwards to the block beside it, at each spring; return
    the least.

    A block reaches towards the rim by `half` its side, one that `rotates` by its corner.
    """
    c, s, least = cos(pose[2]), sin(pose[2]), math.inf
    for e in range(len(beside)):
        wx, wy = way_to_centre(pose, c, s, u, beside, ends, centres, e)
        nx, ny = c * inward[e].real - s * inward[e].imag, s * inward[e].real + c * inward[e].imag
        reach = half
        if rotates:
            offset = yaw[beside[e]] - pose[2]
            reach *= abs(cos(offset)) + abs(sin(offset))
        gap[e] = -(wx * nx + wy * ny) - reach
        least = min(least, gap[e])
    return least
