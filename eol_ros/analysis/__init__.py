# SPDX-License-Identifier: Apache-2.0
"""Bags to numbers, figures and a report, without ROS."""

from eol_ros.analysis.bag import open_bag

__all__ = ['open_bag']
