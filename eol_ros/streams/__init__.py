# SPDX-License-Identifier: Apache-2.0
"""What crosses the graph, said once; no ROS."""
