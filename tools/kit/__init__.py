# SPDX-License-Identifier: Apache-2.0
"""What a workshop needs to build blocks and table, made from docs/build/block.yaml and the code."""
