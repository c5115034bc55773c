# SPDX-License-Identifier: Apache-2.0
"""When images were taken: stamps and times that cannot be meant are named."""

import cv2
import numpy as np
import pytest
from support.definitions import IMAGE as DEFINITION

from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.devices.camera import sources
from eol_ros.devices.camera.image_sequence import open_source
from eol_ros.errors import ConfigError
from eol_ros.streams.images import TYPE, Codec

T0, STEP = 1_700_000_000_000_000_000, 16_666_667
IMAGE = np.zeros((40, 60), np.uint8)


@pytest.mark.parametrize(
    ('stamps', 'kept', 'told'),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3], []),
        ([0, 1, 1, 2, 0, 3], [0, 1, 2, 3], ['2 images whose stamps fall back']),
        ([0, 10**9, 1, 2], [0, 1, 2], ['1 images whose stamps fall back or jump ahead']),
        ([None, None, None], [0, 1, 2], ['3 images have a stamp of 0']),
    ],
)
def test_stamps_of_a_bag(tmp_path, stamps, kept, told):
    codec = Codec(DEFINITION)
    bag = BagWriter(tmp_path / 'bag', [BagTopic('/eol/camera/image_raw', TYPE, DEFINITION)], {})
    for k, stamp in enumerate(stamps):
        data = codec.pack(0 if stamp is None else T0 + stamp * STEP, IMAGE)
        bag.write('/eol/camera/image_raw', data, T0 + k * STEP, T0, k + 1)
    bag.close()
    source = open_source(str(tmp_path))  # the newest bag in a folder
    assert source.name == str(tmp_path / 'bag')
    assert [round((t - T0 * 1e-9) / STEP * 1e9) for t, _ in source.read()] == kept
    assert [note for note in source.notes if not any(part in note for part in told)] == []
    assert len(source.notes) == len(told)


def test_pictures_count_before_bags_beside_them_and_a_bag_may_have_no_images(tmp_path):
    BagWriter(tmp_path / 'bag', [BagTopic('/eol/slips', TYPE, DEFINITION)], {}).close()
    with pytest.raises(ConfigError, match=r'bag: has no raw images; `recorder: {images: all}` kee'):
        open_source(str(tmp_path))
    cv2.imwrite(str(tmp_path / 'a.png'), IMAGE)
    assert len(list(open_source(str(tmp_path)).read())) == 1


@pytest.mark.parametrize(
    ('options', 'times'),
    [({}, [0.0, 1 / 60, 0.5, 0.6]), ({'fps': 60}, [k / 60 for k in range(4)])],
)
def test_uneven_times_of_a_video_count_and_are_told(tmp_path, monkeypatch, options, times):
    path = tmp_path / 'v.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*'FFV1'), 60, (60, 40), False)
    for _ in range(4):
        writer.write(IMAGE)
    writer.release()
    said = iter([2.0, 2.0 + 1 / 60, 2.5, 2.6])
    monkeypatch.setattr(sources.VideoFile, 'position_s', lambda self: next(said))
    source = open_source(str(path), **options)
    assert [time_s for time_s, _ in source.read()] == pytest.approx(times)
    assert len(source.notes) == (0 if options else 1)
