# SPDX-License-Identifier: Apache-2.0
"""The states of the tracker, as in eol_msgs/Blocks; here, so that who reads them loads no more."""

SEARCHING, TRACKING, LOST, CALIBRATING, FAULT = range(5)
STATES = ('searching', 'tracking', 'lost', 'calibrating', 'fault')
