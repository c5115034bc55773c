# SPDX-License-Identifier: Apache-2.0
"""Constants of the appearance tracker: each with its unit and where it comes from.

Sizes and tolerances follow from the table, the image and the arithmetic. The shares, gains and nats
under *Decisions* and *Motion* were chosen on some ten films of two renderers that were looked at.
Lengths in px are of the image.
"""

import math
from typing import NamedTuple

from eol_ros.core.table import Table

# The face of a block
CELLS = 12  # of the brightness map, along each axis: 3.8 px at 545 px/m
# Standard deviation of an edge, tried in the first image: of a usual lens and a pixel, then sharper
# and wider ones
FIRST_BLUR_PX = 1.3, 1.0, 0.8, 0.63, 0.5, 1.65, 2.1, 2.7, 3.4
BLUR_PX = 0.4, 4.0  # from a pixel's own to that of a lens far out of focus
BLUR_LOOKS = 24  # of printed covers: after more, uneven light near the sides widens edges
YOUNG = 12  # looks; the mean of fewer is noisier than a third of one image
REDRAWN = 8  # looks after which the mean has changed enough to be used
MAX_LOOKS = 60.0  # then older ones fade: a lamp's light on a cover must not be kept for its own
SPREAD = 1e-5, 0.02  # variance of pixels about a face, shares squared: 0.3 % to 14 %
SPREAD_LOOKS = 100.0  # over which it is averaged

# Registration
LANES = 8  # pixels of one vector of AVX2, whose records lie together
MOST_PX = 16000  # pixels of one block: enough for one 200 px wide; what exceeds them is left out
EVERY = 3  # row and column of the pixels that are read where light does not change
# Standard deviations of an edge within which every pixel is read: of flat covers 99 % of its slope;
# of printed ones, once known, 95 %: further in their light falls off in its own way
DENSE = 2.6, 2.0
MARGIN_PX = 0.5  # beyond that, for the rounding of a pose
KEPT_PX = 0.25  # a patch moves with a block that has moved or turned by more
STALE_PX = 0.5  # and is made again for one that turned by more, or with a margin of another width
OUTSIDE_PX = 3.0  # beyond that, for the ground around a block
LEAST_VARIANCE = 1.0  # grey levels squared, of a pixel: what rounding and compression leave
FULL = 250.0  # grey levels; from here a pixel may be saturated
TUKEY = 20.0  # variances; 4.5 standard deviations: 95 % efficient for normal noise (Huber, 2009)
UNEVEN = 2.0  # variance in that of the noise alone, of 24 parts: 3 standard deviations
BESIDE = 2.0  # times sigma: what hides or lights part of a block also errs where it looks like it
SETTLED = 1.0  # of the standard deviation of a pose: a smaller step ends the iteration
MODEL_PX = 0.012  # what the edge function leaves of a real edge
MOVING_SHARE = 0.05  # and of one that moves, of its way in an image: 3 ms of exposure at 60 Hz
JUDGED_PX = 0.03  # a pose that was taken to be less sure is fitted once more
RESTED_PX = 0.08  # px: below it one Gauss-Newton step suffices, whose error is cubic: some 2e-4 px
STANDS = 4.0  # standard deviations from a fit in full within which a block rests: 2.8 of both
TOGETHER = 3  # adjacent parts of a side whose errors are correlated
PARTS = 12  # of a side, each trusted by itself: 3.8 px at 545 px/m
# Mean squared residual, in the usual one: of a part of a side, from which it is trusted less, and
# not at all; of a side (130 px are judged: 5 standard deviations)
PART_MISFIT, SIDE_MISFIT = (2.2, 5.0), 1.6
ROUNDS = 12  # a cover that nothing is known of takes five before its sides are judged
ROUNDS_LOST = 30  # iterations of the fit of a block that may have jumped
# First taken to be where it was: a block of PREDICTED_PX and a way of 0.05 px in an image, whose
# gain changes by less
RESTS_PX, STEADY = 0.715, 0.05
HOPELESS = 0.3  # of a cover that agrees after half of the rounds
GAIN_SIGMA = 0.25  # of the gain expected: flash and battery within a frame
PLANE_SIGMA = 0.05  # of the gain: slope of the ground's light over half a block
# Of a side: gain and ground beside the block's, slope of the gain over half a block. Least and
# greatest variance, as shares of the gain squared, the second of flat covers and of printed ones,
# whose light falls off towards their sides; the most of each, as a share of the gain
LEAST_OWN, MOST_OWN = (1e-6, 1e-6, 1e-5), ((0.01, 0.01, 0.003), (0.01, 0.01, 0.02))
SIDE_MOST = 0.3, 0.3, 4.0
COARSE_PX = 0.5  # of a pose less sure, sides are taken to be as usual
OWN_LOOKS = 30.0  # over which these are averaged
STEP_PX, STEP_RAD = 6.0, 0.2  # the longest step of one iteration
LAST_STEP_PX = 0.2  # the longest last step of a converged fit, and from where a face was taken

# Decisions
NOISE_EVERY = 16  # images between two looks at the image's noise
CLOSELY = 8  # images between two close looks at a block that looks as usual
ALIKE, MISFIT = 0.97, 1.5  # visible less, or misfit more, is not as usual
AGREE = 12.0  # variances; chi squared of one pixel exceeds it with probability 5e-4
WIDEN = 3.0  # residuals may exceed their variance by so much while a pose is sought
WIDEN_JUDGED = 1.5  # and when it is judged
MIN_VISIBLE = 0.4  # of a cover
MIN_VISIBLE_YOUNG = 0.9
WHOLE = 0.95  # from here a cover is learned from
MIN_RING, MIN_RING_YOUNG = 0.45, 0.55  # of the ground beside the edges that is explained
MIN_RATIO = 1.2  # nats a pixel for the cover against flat ground
SIDE_NATS = -4.0, 10.0  # what one side can say; a covered side must not veto the other three
IMAGE_NATS = -6.0, 20.0  # what one image can say
ACCEPT_NATS = 8.0  # Wald: a false acceptance has a probability of e^-8
FIRST_NATS = 1.5  # while nothing is known
CLEAR_NATS = 28.0  # all four sides show
# greatest standard deviation to accept a lost block of which some sides are hidden: within
# EXPECTED_PX of its predicted place, and further off
EXPECTED_PX, SURE_PX = 4.0, (0.4, 0.15)
PART_NATS = 6.0  # and least evidence of its sides together
MOSTLY = 0.7  # visible: then a lamp may hide the sides
NO_SIDES = -12.0  # nats: all four sides are against it
THREE_NATS = 23.0  # three sides show
WEAKEST_NATS = -2.0  # the weakest side of a square whose face is not known
CLEAR_RING = 0.8  # of the ground: then no arm crosses two sides, and one side may look otherwise
FRESH_NATS = 30.0  # a square other than the face learned: more than three sides must show
NATS = -3.0, 20.0
MAX_SIGMA_PX = 0.7  # of a place that is reported
GAINS = 0.45, 2.2  # of the gain expected
MIN_GAIN = 0.2  # of the median gain, for a face not known
RELEARN = 5  # images that show another face in a block's place

# Turn
CELLS_ALIKE = 8.0  # cells of a face that err together: as one
COVER_SIGMA = 0.03  # of a cell beside what its spread says: lamps, warmth
TURN_NATS = 12.0  # as symmetry.ERROR: a wrong turn has a probability of e^-12
SAME_M, SAME_SHARE = 1e-3, 0.8  # so many blocks that stand where they stood tell the turn
SAME_S = 0.3  # lost for less, the lattice has not turned by 45 degrees: 150 degrees a second

# Motion. Lengths for a pitch of 174 mm and blocks of 84 mm: see `Lengths`
LOSE_M = 0.11  # from where its neighbours put it: 0.6 pitch
STRAY_M = 0.065  # of a block that is looked for: 0.4 pitch, so that no neighbour's place is reached
NEAR_SIDES = 0.7  # of a side between two middles: closer, both are one square
NEIGHBOURHOOD = 1.3  # pitches: width of the weight of neighbours
MAX_AHEAD_S = 0.1  # a velocity is not carried on for longer
# standard deviation of a prediction: fixed, and as a share of the way
PREDICTED_PX, PREDICTED_SHARE = 0.7, 0.3
UNSEEN_PX = 0.05  # that of a block out of sight grows by so much in an image
LOST_PX = 6.0
LEAST = 5  # blocks in sight at least; with fewer, no usual change is known and the lattice is lost
MORE = 2  # a lattice a row further on is right if it sees this many border blocks more
AGAIN_S = 0.5, 600.0  # from one look for it to the next, while a block was never seen: first, last
SEEN_SHARE, LOST_IMAGES = 0.32, 6  # with fewer blocks for longer, the lattice is sought again
LEARN_PX = 4.0  # in one image: a cell of a face; faster blocks are not learned from
STILL_PX = 1.0  # slower ones show the width of edges

# At rest: blocks that stay within REST_M for REST_S; told for so long that a cover was changed
REST_S, REST_M = 0.1, 6e-4
CHANGED_S = 600.0

# Search
SEEK_S = 0.08  # between two searches for the lattice
CELL_M = 0.008  # of the grid of places: a tenth of a block
TURNS = 5  # angles of a square within its quarter turn
NODE_STRAY_M = 0.035  # how far a block may lie from its node when nothing is known
ANGLES = 30  # of the lattice, within its quarter turn
CLIP = 8.0  # standard deviations; a square that stands out further cannot do so more
# samples along the axes inside, along a side of the ring; its distance as a share of a side
INNER, RING, GAP = 5, 5, 0.14
REACH_M = 0.75  # of places from the middle of the table
CENTRE_M = 0.26  # largest distance of the rim's centre from the platform's: its reach and a margin
MIN_SUM = 0.35  # of the greatest response of all nodes
MIN_RESPONSE = 0.7


class Lengths(NamedTuple):
    """Lengths of a table in m for kernels, scaled from those of the paper's table."""

    half_side: float
    near: float  # between two centres
    lose: float
    stray: float
    width: float  # of the weight of neighbours
    cell: float
    node_stray: float
    reach: float
    centre: float

    @classmethod
    def of(cls, table: Table) -> 'Lengths':
        """Return those of a table: by its pitch, its blocks' side, and how far its rim reaches."""
        usual = Table()
        pitch, side = min(usual.pitch_m), table.block_side_m
        far = CENTRE_M * max(table.reach_m) / max(usual.reach_m)
        corner = float(abs(usual.rest).max()) * 2**0.5 + CENTRE_M
        return cls(
            side / 2, NEAR_SIDES * side, LOSE_M * table.scale, STRAY_M * table.scale,
            NEIGHBOURHOOD * (pitch * table.scale), CELL_M * side / usual.block_side_m,
            NODE_STRAY_M * table.scale,
            REACH_M * (math.sqrt((table.rest**2).sum(axis=1).max()) + far) / corner, far,
        )  # fmt: skip
