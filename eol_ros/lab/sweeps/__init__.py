# SPDX-License-Identifier: Apache-2.0
"""Parameter sweeps: what is asked, who computes it, and the table of what came of it."""
