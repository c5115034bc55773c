# SPDX-License-Identifier: Apache-2.0
"""What must hold of every bag."""

import json


def counted_losses(bag):
    """Check that what is missing between the first and the last message is what the bag says is.

    bag: analysis.Bag. Returns the counts by topic, lost on the way and dropped by the recorder.
    """
    lost = {
        name: json.loads(bag.gaps[name]) for name in ('lost_before_recorder', 'dropped_in_recorder')
    }
    for topic, counter in (('blocks', 'image'), ('grain_triggers', 'sequence')):
        numbers = bag.table(topic)[counter].astype(int)
        absent = numbers[-1] - numbers[0] + 1 - len(numbers)
        assert absent == sum(counts.get(f'/eol/{topic}', 0) for counts in lost.values()), topic
    return lost
