# SPDX-License-Identifier: Apache-2.0
"""Projectors that are switched over the network."""
