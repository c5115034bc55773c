# SPDX-License-Identifier: Apache-2.0
"""Chooses the pair on the two walls: shuffles while anything moves, freezes when all is still."""

import time

import numpy as np
from eol_msgs.msg import Slip, Wall

from eol_ros.core.montage.damage import Damage
from eol_ros.core.montage.shuffle import Flip, Shuffle
from eol_ros.devices.files.media_folder import MediaFolder, Pair
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import now_ns, system_ns, to_msg
from eol_ros.said import said
from eol_ros.streams.requests import Asked

RELOAD_S = 1.0


class MontageNode(EolNode):
    """slips -> wall. An empty `left` and `right` means black: the work sleeps.

    The shuffle counts in steady time, so a system clock that is set stops or hurries no wall.
    """

    NAME = 'montage'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s = self.settings
        self.folder = MediaFolder(s.pairs)
        rng = np.random.default_rng(s.seed)
        self.shuffle = Shuffle(len(self.folder.pairs), s.period_s, rng, s.lead_s)
        self.damage = Damage(s.heal_s, self.table.count)
        self.pair = self.folder.pairs[0]  # that is shown
        self.asleep = bool(self.resumed.get('asleep'))
        self.wall = Wall()
        self.wall.header.stamp = to_msg(now_ns())
        self.pub = self.publisher('wall')
        self.subscribe('slips', self.on_slip)
        self.requests.serve(sleep=self.on_sleep, wake=self.on_sleep)
        self.beat = self.create_timer(RELOAD_S, self.on_beat, autostart=False)
        self.create_timer(RELOAD_S, self.on_reload)
        self.turn(self.asleep)
        self.report()

    def on_slip(self, slip: Slip) -> None:
        now_s = time.monotonic()
        self.shuffle.slip(slip.block, slip.kind == Slip.KIND_START, now_s)
        if slip.kind == Slip.KIND_START:
            self.damage.slip(slip.block, slip.cascade, now_s)
        if self.wall.moving != bool(self.shuffle.moving):
            self.wall.header.stamp = slip.header.stamp
        self.look()

    def restart(self) -> None:
        self.shuffle.forget()
        if self.asleep:
            self.turn(False)
        self.look()

    def on_beat(self) -> None:
        self.beat.cancel()
        self.look()

    def look(self) -> None:
        flip = None if self.asleep else self.shuffle.update(time.monotonic())
        if flip:
            self.show(flip)
        elif self.wall.moving != bool(self.shuffle.moving):
            self.send()
        if self.shuffle.moving and not self.asleep:  # the next change is due then
            self.resume(self.beat, max(self.shuffle.due_s - time.monotonic(), 0.001))

    def show(self, flip: Flip) -> None:
        pairs, wall = self.folder.pairs, self.wall
        self.pair = pair = pairs[flip.pair]
        # As it was announced: that picture is decoded. Damage shows in the pair after it.
        announced = tuple(wall.ahead[:2])
        known = len(announced) == 2 and announced[0] in pair.lefts and announced[1] in pair.rights
        sides = announced if known else self.sides(pair)
        wall.caption, wall.credit = pair.caption, pair.credit
        wall.ahead = [name for n in flip.coming for name in self.sides(pairs[n])]
        self.change(sides, flip.time_s)

    def sides(self, pair: Pair) -> tuple[str, str]:
        """Return left and right image of a pair, damaged as far as the table has slipped."""
        now_s = time.monotonic()
        left, right = (
            names[self.damage.degree(len(names), now_s)] for names in (pair.lefts, pair.rights)
        )
        return left, right

    def change(self, sides: tuple[str, str], time_s: float) -> None:
        self.health.tick()
        self.wall.change += 1
        self.wall.flip = to_msg(system_ns(time_s))
        self.wall.left, self.wall.right = sides
        self.send()

    def redress(self) -> None:
        """Show the pair that stands there as damaged, or as healed, as it is by now."""
        sides, now_s = self.sides(self.pair), time.monotonic()
        frozen = not self.asleep and not self.shuffle.moving
        if frozen and sides != (self.wall.left, self.wall.right) and self.shuffle.may_change(now_s):
            self.change(sides, now_s + self.settings.lead_s)

    def send(self) -> None:
        self.wall.moving = bool(self.shuffle.moving)
        self.pub.publish(self.wall)

    def on_sleep(self, asked: Asked) -> None:
        if self.asleep == (asked.kind == 'sleep'):
            return
        self.wall.header.stamp = to_msg(now_ns())
        self.turn(not self.asleep)
        self.look()
        self.report()
        self.health.report()

    def turn(self, asleep: bool) -> None:
        self.asleep = asleep
        self.keep(asleep=asleep)
        if asleep:
            self.wall.change += 1
            self.wall.left = self.wall.right = self.wall.caption = self.wall.credit = ''
            self.wall.flip = to_msg(now_ns())
            self.send()
        else:
            self.show(self.shuffle.show(time.monotonic()))

    def on_reload(self) -> None:
        if self.folder.refresh():
            self.shuffle.replace(len(self.folder.pairs))
            if not self.asleep:
                self.show(self.shuffle.show(time.monotonic()))
        self.redress()
        self.report()

    def report(self) -> None:
        count, skipped = len(self.folder.pairs), self.folder.skipped
        self.health.values.update(
            pairs=count, skipped=len(skipped), changes=self.wall.change, asleep=self.asleep
        )
        if skipped:
            names = '; '.join(skipped[:3])
            self.health.warn(said('skipped', count=count, names=names))
        elif self.asleep:
            self.health.ok(said('pairs_asleep', count=count))
        else:
            self.health.ok(said('pairs', count=count))
