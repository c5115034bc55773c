# SPDX-License-Identifier: Apache-2.0
"""What was asked of the nodes while a bag was recorded."""

import numpy as np

from eol_ros.devices.bag.reader import BagReader
from eol_ros.streams.cdr import Decoder
from eol_ros.streams.requests import Heeded, recorded, recorded_as_control

REQUESTS, RESULTS, CONTROL = '/eol/requests', '/eol/request_results', '/eol/control'


def heeded(bag: BagReader) -> list[Heeded]:
    """Return the requests of a bag of any version, in order of recording."""
    if REQUESTS in bag.topics and RESULTS in bag.topics:
        return recorded(_columns(bag, REQUESTS), _columns(bag, RESULTS))
    return recorded_as_control(_columns(bag, CONTROL)) if CONTROL in bag.topics else []


def _columns(bag: BagReader, name: str) -> dict[str, np.ndarray]:
    messages = list(bag.messages([name]))
    logs = np.array([message.log_ns for message in messages], 'datetime64[ns]')
    topic = bag.topics[name]
    decoder = Decoder(topic.type, topic.definition)
    return {'log_time': logs} | decoder.table([message.data for message in messages])
