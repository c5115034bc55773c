# SPDX-License-Identifier: Apache-2.0
"""The corpus and its triggers as messages."""

from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from eol_msgs.msg import Corpus as CorpusMessage
from eol_msgs.msg import GrainTrigger

from eol_ros.core.sound.corpus import DESCRIPTORS, Corpus
from eol_ros.ros.stamps import to_msg


def trigger_to_msg(stamp_ns: int, sequence: int, row: np.void) -> GrainTrigger:
    """Return the message of one TRIGGER; the stamp is that of the image, unchanged."""
    message = GrainTrigger(
        sequence=sequence,
        grain=int(row['grain']),
        block=int(row['block']),
        gain=float(row['gain']),
        rate=float(row['rate']),
        pan=float(row['pan']),
        attack=float(row['attack_s']),
        release=float(row['release_s']),
    )
    message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'table'
    return message


def corpus_to_msg(
    stamp_ns: int, corpus: Corpus, bounds: Sequence[float], radius_m: float
) -> CorpusMessage:
    """Return the message of a corpus over `bounds`: x min, y min, x max, y max in metres."""
    grains = corpus.grains
    values = np.stack([grains[name] for name in DESCRIPTORS], axis=1)
    message = CorpusMessage(
        name=Path(corpus.sources[0].path).name,
        digest=corpus.digest,
        sample_rate=corpus.sample_rate,
        files=[source.path for source in corpus.sources],
        file=array('I', grains['file'].astype(np.uint32).tobytes()),
        start=array('d', grains['start_s'].tobytes()),
        duration=array('d', grains['duration_s'].tobytes()),
        x=array('f', grains['x'].astype(np.float32).tobytes()),
        y=array('f', grains['y'].astype(np.float32).tobytes()),
        x_name=corpus.x_name,
        y_name=corpus.y_name,
        bounds=array('d', bounds),
        radius=radius_m,
        descriptors=list(DESCRIPTORS),
        values=array('f', values.astype(np.float32).tobytes()),
    )
    message.header.stamp, message.header.frame_id = to_msg(stamp_ns), 'table'
    return message
