# SPDX-License-Identifier: Apache-2.0
"""What the maker of the README's film tells its pages."""

import json

from support.bag_samples import bag_of


def test_pages_are_told_what_a_bag_has_for_them(tmp_path):
    from eol_msgs.msg import Block, Blocks, LedCommand, Slip, Truth

    from assets.film.__main__ import Teller

    blocks = Blocks(blocks=[Block(id=k) for k in range(25)])
    blocks.header.frame_id = 'table'
    truth = Truth(x=[0.0] * 25, y=[0.0] * 25, yaw=[0.0] * 25, moving=[False] * 25)
    messages = [
        ('blocks', blocks, 0),
        ('truth', truth, 0),
        ('led_commands', LedCommand(white=bytes(25)), 0),
        ('slips', Slip(), 0),
    ]
    teller = Teller(bag_of(tmp_path / 'run', messages))

    assert [one.sticky for one in teller.told()] == ['blocks', 'truth', 'leds', '']
    assert json.loads(teller.documents['lattice'])['rows'] == 5
