# SPDX-License-Identifier: Apache-2.0
"""Publishes the corpus, and a trigger for every grain that a moving block touches."""

from pathlib import Path

from eol_msgs.msg import Corpus as CorpusMessage
from eol_msgs.msg import FeltSlip, GrainTrigger

from eol_ros.core.sound.corpus import Corpus
from eol_ros.core.sound.select import Selector
from eol_ros.core.sound.sources import absent
from eol_ros.devices.corpus.corpus_file import LEFT_OUT, move, moved, restore
from eol_ros.devices.corpus.loader import CorpusLoader, corpus_spec
from eol_ros.errors import EolError
from eol_ros.nodes.sound_files import SoundFiles
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import LATER
from eol_ros.ros.stamps import to_ns
from eol_ros.said import clauses, said
from eol_ros.streams import blocks, triggers
from eol_ros.streams import corpus as corpora
from eol_ros.streams.requests import Asked


class GrainsNode(EolNode):
    NAME = 'grains'

    def __init__(self, settings, **kwargs):
        super().__init__(settings, **kwargs)
        self.selector = Selector(self.settings, table=self.table)
        self.corpus: Corpus | None = None
        self.sequence = 0
        self.triggers = self.publisher('grain_triggers')
        self.felt_triggers, self.felt = self.publisher('felt_triggers'), 0
        self.corpora = self.publisher('corpus')
        self.loader, self.files = CorpusLoader(), SoundFiles(self)
        self.awaited: list[Asked] = []
        self.notes: tuple[str, ...] = ()  # on weights
        self.spec = corpus_spec(self.settings)
        self.health.expects(said('blocks_data'))
        self.tell_settings(self.settings)
        ready = self.loader.at_once(self.spec)
        if ready is not None:  # before the first image: a replay must find the corpus in place
            self.show(ready)
        else:
            self.loader.ask(self.spec)
        self.create_timer(0.2, self.on_timer)
        self.subscribe('blocks', self.on_blocks)
        self.subscribe('felt_slips', self.on_felt)
        self.requests.serve(move_grain=self.on_move_grain, restore_grain=self.on_restore_grain)

    def on_settings(self, new) -> None:
        if corpus_spec(new) != self.spec:
            self.spec = corpus_spec(new)
            self.loader.ask(self.spec)
        self.tell_settings(new)
        told, self.selector.settings = self.selector.settings.space_m, new
        if self.corpus is not None and told != new.space_m:
            self.corpora.publish(self.message(self.corpus))

    def tell_settings(self, new) -> None:
        folders = [Path(x).name for x in (new.sound, *new.more_sounds) if x and Path(x).is_dir()]
        names = ('radius', 'blend', 'mode', 'weights', 'regions', 'paths')
        told = {'folders': folders} | {name: getattr(new, name) for name in names}  # for the panel
        self.tell_absent(new.weights, folders)
        if not told.items() <= self.health.values.items():
            self.health.values.update(told)
            self.health.report()

    def tell_absent(self, lines: tuple[str, ...], empty: list[str]) -> None:
        """Tell of weights of sounds that are not there; they count when these have come."""
        sources = self.corpus.sources if self.corpus else ()
        names, folders = [x.name for x in sources], [x.folder for x in sources]
        found = absent(lines, names, folders, empty) if sources else []
        notes = tuple(f'weights {line}' for line in found)
        if notes == self.notes:
            return
        for note in set(notes) - set(self.notes):
            self.get_logger().warning(note)
        self.notes = notes
        self.tell()

    def tell(self) -> None:
        if self.corpus is not None:
            left_out = [note for note in self.corpus.notes if note.startswith(LEFT_OUT)]
            self.health.ok(clauses([self.words, *self.notes, *left_out[:3]]))

    def restart(self) -> None:
        self.selector = Selector(self.settings, self.corpus, self.table)
        self.sequence = self.felt = 0

    def time_jumped(self, jump_ns: int) -> None:
        """The selector sees it in the stamps themselves; the triggers count on."""

    def _on_set(self, asked: Asked) -> object:
        before = self.spec
        text = super()._on_set(asked)
        if self.spec == before:
            return text
        self.awaited.append(asked)  # until the corpus that it asks for is there, or cannot be
        return LATER

    def answer_awaited(self, accepted: bool, text: str) -> None:
        for asked in self.awaited:
            self.requests.answer(asked, accepted, text)
        self.awaited.clear()

    def on_move_grain(self, asked: Asked) -> str:
        if self.corpus is None:
            raise EolError(said('no_corpus'))
        v = asked.values
        path = move(self.corpus, v['grain'], v['x'], v['y'])  # the timer sees the file change
        return said('kept_in', name=path.name)

    def on_restore_grain(self, asked: Asked) -> str:
        if self.corpus is None:
            raise EolError(said('no_corpus'))
        return f'forgotten in {restore(self.corpus, asked.values["grain"]).name}'

    def on_timer(self) -> None:
        if self.loader.changed(self.spec):  # a grain moved by hand, another sound of the same name
            self.loader.ask(self.spec)
        outcome = self.loader.take()
        if isinstance(outcome, Corpus):
            if self.corpus is None or not outcome.same_as(self.corpus):
                self.show(outcome)
            self.tell()  # also when a sound that was gone has come back
            self.answer_awaited(True, self.words)
        elif isinstance(outcome, EolError) and self.corpus is None:
            raise outcome  # nothing to play: the run ends with the line that says why
        elif isinstance(outcome, EolError):
            text = clauses([str(outcome), said('plays_on')])
            self.health.warn(text)
            self.answer_awaited(False, text)

    def show(self, corpus: Corpus) -> None:
        self.corpus = corpus
        since_s = self.selector.load(corpus, corpus.reading_s)
        self.since_ns = self.now_ns() if since_s < 0 else round(since_s * 1e9)
        message = self.message(corpus)
        self.corpora.publish(message)
        self.files.look(message.files)
        for note in corpus.notes:
            self.get_logger().warning(note)
        self.health.values['grains'] = len(corpus)
        count, name = int(corpus.placed.sum()), corpora.title(corpus)
        self.words = said('grains', count=count, name=name)
        self.tell()
        self.tell_settings(self.settings)  # a weight may name a sound that came, or has gone

    def on_blocks(self, message: blocks.Blocks) -> None:
        self.health.tick()
        self.stamped(message.stamp_ns)
        rows = message.rows
        found = self.selector.update(
            message.stamp_s, rows['x'], rows['y'], message.known, rows['sigma']
        )
        for row in found:
            trigger = triggers.of(message.stamp_ns, self.sequence, row)
            self.triggers.publish(triggers.RECORD.fill(GrainTrigger(), trigger, self.frame_prefix))
            self.sequence += 1
        self.health.values.update(triggers=self.sequence, capped=self.selector.capped)

    def on_felt(self, slip: FeltSlip) -> None:
        if slip.kind != FeltSlip.KIND_PROVISIONAL:
            return
        stamp_ns = to_ns(slip.header.stamp)
        for row in self.selector.felt(stamp_ns * 1e-9, slip.block, slip.x, slip.y, slip.strength):
            trigger = triggers.of_knock(stamp_ns, self.felt, row)
            self.felt_triggers.publish(
                triggers.RECORD.fill(GrainTrigger(), trigger, self.frame_prefix)
            )
            self.felt += 1
        self.health.values['felt'] = self.felt

    def message(self, corpus: Corpus) -> CorpusMessage:
        bounds, radius = self.selector.bounds, self.selector.radius_m
        row = corpora.of(self.since_ns, corpus, bounds, radius, moved(corpus))
        return corpora.RECORD.fill(CorpusMessage(), row, self.frame_prefix)

    def close(self) -> None:
        self.loader.close()
