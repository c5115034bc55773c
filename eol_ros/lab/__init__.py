# SPDX-License-Identifier: Apache-2.0
"""The laboratory: simulations, automata, laws, sweeps; nothing that runs on site imports it."""
