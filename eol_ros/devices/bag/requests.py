# SPDX-License-Identifier: Apache-2.0
"""What was asked of the nodes while a bag was recorded."""

import numpy as np

from eol_ros.devices.bag.reader import BagReader
from eol_ros.streams.cdr import Decoder
from eol_ros.streams.requests import Heeded, recorded

REQUESTS, RESULTS = 'requests', 'request_results'


def heeded(bag: BagReader) -> list[Heeded]:
    """Return the requests of a bag, in order of recording."""
    requests, results = map(bag.name, (REQUESTS, RESULTS))
    if not {requests, results} <= bag.topics.keys():
        return []
    return recorded(_columns(bag, requests), _columns(bag, results))


def _columns(bag: BagReader, name: str) -> dict[str, np.ndarray]:
    messages = list(bag.messages([name]))
    logs = np.array([message.log_ns for message in messages], 'datetime64[ns]')
    topic = bag.topics[name]
    decoder = Decoder(topic.type, topic.definition)
    return {'log_time': logs} | decoder.table([message.data for message in messages])
