# SPDX-License-Identifier: Apache-2.0
"""What tests share that is no test: waiting, sample bags, devices that are plugged, a browser."""
