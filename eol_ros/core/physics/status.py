# SPDX-License-Identifier: Apache-2.0
"""How a simulation ended."""

OK, STEP_LIMIT, EVENT_LIMIT, NOT_FINITE = range(4)
STIFF, GLIDING = 4, 5  # no ends: a run that goes on by sweeps, or by the modes of all blocks
WORDS = ('ok', 'step limit', 'event limit', 'not finite')
