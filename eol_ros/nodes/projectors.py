# SPDX-License-Identifier: Apache-2.0
"""Switches the projectors by PJLink: on while the work is awake, off when it has fallen asleep."""

import time

from eol_ros.devices.projector.pjlink import host_and_port
from eol_ros.devices.projector.projector import ERROR, NOT_ASKED, WARN, Projector
from eol_ros.errors import ConfigError
from eol_ros.ros.node import EolNode
from eol_ros.said import clauses, said
from eol_ros.streams.requests import Asked

LOOK_S = 1.0
NETWORK_S, NETWORK_HUNG_S = 30.0, 120.0  # time limits for a round of queries
HOURS_S = 10.0  # so long it is waited for what the node `hours` has to say


class ProjectorsNode(EolNode):
    """They stay as they are when the run ends."""

    NAME = 'projectors'
    HOLDS = False

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        s = self.settings
        if not s.addresses:
            raise ConfigError('addresses: no projector is named')
        for address in s.addresses:
            host_and_port(address)
        self.asleep = bool(self.resumed.get('asleep'))
        self.off_s = time.monotonic()  # when they go off, while it is asleep
        self.all = [Projector(address, s.password, not self.asleep) for address in s.addresses]
        # Started outside of the hours, it does not switch them on first.
        wait_s = HOURS_S if 'hours' in self.scene.nodes else 0.0
        self.start_s = time.monotonic() + wait_s
        self.requests.serve(sleep=self.on_sleep, wake=self.on_sleep)
        for projector in self.all:
            self.health.watches(projector.address, projector.rounds, NETWORK_S, NETWORK_HUNG_S)
        self.create_timer(LOOK_S, self.look)
        self.look()

    def on_sleep(self, asked: Asked) -> str | None:
        asleep = asked.kind == 'sleep'
        now_s, on = time.monotonic(), self.all[0].started
        if asleep and not self.asleep:
            self.off_s = now_s + self.settings.off_after_s * on
        self.asleep, self.start_s = asleep, now_s
        self.keep(asleep=asleep)
        self.look()
        left_s = self.off_s - time.monotonic()
        return said('projectors_off', seconds=f'{left_s:.0f}') if asleep and left_s > 0 else None

    def look(self) -> None:
        on = not self.asleep or time.monotonic() < self.off_s
        for projector in self.all:
            projector.want(on)
            if time.monotonic() >= self.start_s and not projector.started:
                projector.start(self.settings.poll_s)
        if any(projector.reading.trouble == NOT_ASKED for projector in self.all):
            return  # starting
        levels = [projector.level() for projector in self.all]
        for number, projector in enumerate(self.all, 1):
            reading = projector.reading
            self.health.values[f'power_{number}'] = -1 if reading.power is None else reading.power
            if reading.lamps_h:
                self.health.values[f'lamp_{number}_h'] = max(reading.lamps_h)
        say = {ERROR: self.health.error, WARN: self.health.warn}.get(max(levels), self.health.ok)
        say(clauses(projector.words() for projector in self.all))

    def close(self) -> None:
        for projector in self.all:
            projector.end()
