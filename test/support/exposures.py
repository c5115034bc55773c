# SPDX-License-Identifier: Apache-2.0
"""What the twin's virtual camera did, by the stamps of its images."""

NS = 1_000_000_000


def moved_to(first_ns: int, before_ns: int, stamp_ns: int, rate_hz: float) -> list[int]:
    """Return the stamps for which `move` was called from an image to the next one.

    first_ns, before_ns, stamp_ns: of the first image, of one, and of the next. Where images were
    skipped between these, the first of them had been moved to already.
    """
    period_ns = NS / rate_hz
    before, image = (round((at_ns - first_ns) / period_ns) for at_ns in (before_ns, stamp_ns))
    skipped = [first_ns + round((before + 1) * period_ns)] if image > before + 1 else []
    return [*skipped, stamp_ns]
