# SPDX-License-Identifier: Apache-2.0
"""How a simulation ended."""

OK, STEP_LIMIT, EVENT_LIMIT, NOT_FINITE = range(4)
WORDS = ('ok', 'step limit', 'event limit', 'not finite')
