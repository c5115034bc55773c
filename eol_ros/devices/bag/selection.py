# SPDX-License-Identifier: Apache-2.0
"""What of a run is kept, and what was lost on the way. Pure bookkeeping over messages."""

import json
import statistics
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from eol_ros.settings import RecorderSettings
from eol_ros.streams.cdr import stamp_ns

if TYPE_CHECKING:  # the tracker counts images without MCAP
    from eol_ros.devices.bag.mcap_file import BagMessage

NS = 1_000_000_000
KNOWN = 5  # so many intervals tell a rhythm
LATEST_NS = 10 * NS  # a message is handed over no later than this: readers keep ten seconds of them
SLIP_LIMIT_NS = 10 * NS  # a slip whose stop never came is over by then
MOST_REQUESTS, LONGEST_ID = 20_000, 200  # number and length of remembered ids


class LogTimes:
    """When messages of one bag were received and sent, in ns: never before one of their own topic.

    What is told of a time may be wrong, where a clock was set or a replay has not told enough of
    its own: what is not one of the last moments counts as now.
    """

    def __init__(self, begun_ns: int = 0):
        self._begun_ns = begun_ns  # no message of this bag came before
        self._last: dict[str, int] = {}  # topic: when its last message was received

    def take(self, topic: str, received_ns: int, sent_ns: int, now_ns: int) -> tuple[int, int]:
        """Return reception and sending time of the next message of `topic`, handed over now."""
        log_ns = max(self._believed(received_ns, now_ns), self._last.get(topic, 0) + 1)
        self._last[topic] = log_ns
        return log_ns, self._believed(sent_ns, log_ns)

    def _believed(self, at_ns: int, by_ns: int) -> int:
        """Return `at_ns` where it is one of the last moments before `by_ns`, else that."""
        return at_ns if max(self._begun_ns, by_ns - LATEST_NS) <= at_ns <= by_ns else by_ns


class Dropped(NamedTuple):
    """What is left of a message that there was no room for: the beginning, for its stamp."""

    topic: str
    head: bytes
    sequence: int


class Slipping(NamedTuple):
    """News of slip `number`: it has started, or stopped, at `log_ns`."""

    number: int
    started: bool
    log_ns: int


class AroundSlips:
    """Keeps the images from `before_s` before a slip's start to `after_s` after its stop.

    Holds `before_s` of images in memory while nothing slips: 1 MB each.
    """

    def __init__(self, before_s: float, after_s: float):
        self._before_ns = round(before_s * NS)
        self._after_ns = round(after_s * NS)
        self._ring: deque[BagMessage] = deque()
        self._open: dict[int, int] = {}  # slip -> when it started
        self._until_ns = -1

    def slip(self, news: Slipping) -> 'Iterator[BagMessage]':
        """Take note of a start or a stop; yield the images from before it."""
        if news.started:
            self._open[news.number] = news.log_ns
        else:
            self._open.pop(news.number, None)
        self._until_ns = max(self._until_ns, news.log_ns + self._after_ns)
        while self._ring:
            item = self._ring.popleft()
            if item.log_ns >= news.log_ns - self._before_ns:
                yield item

    def image(self, item: 'BagMessage') -> 'Iterator[BagMessage]':
        """Yield the image if it is to be kept now; remember it for a while if not."""
        for number, start_ns in list(self._open.items()):
            if item.log_ns - start_ns > SLIP_LIMIT_NS:
                del self._open[number]
        if self._open or item.log_ns <= self._until_ns:
            yield item
            return
        self._ring.append(item)
        while self._ring and self._ring[0].log_ns < item.log_ns - self._before_ns:
            self._ring.popleft()


class RateLimiter:
    """Lets one message of a topic through per period: images and meters made for the eye."""

    def __init__(self, period_s: float):
        self._period_ns = round(period_s * NS)
        self._next_ns: dict[str, int] = {}

    def keep(self, item: 'BagMessage') -> bool:
        """Return whether `item` is the one of its period."""
        due = self._next_ns.get(item.topic, 0)
        if item.log_ns < due:
            return False
        late = item.log_ns - due >= self._period_ns
        self._next_ns[item.topic] = (item.log_ns if late else due) + self._period_ns
        return True


class Gaps:
    """Counts messages that were sent and never came, by the numbers that publishers give them.

    Each publisher of a topic counts up from 1. A message comes next after the highest number below
    its own; where there is none, it is the first of another publisher or of a restarted one, and
    nothing was lost.
    """

    def __init__(self) -> None:
        self.lost: Counter[str] = Counter()
        self.received: Counter[str] = Counter()
        self._last: dict[str, set[int]] = {}  # of each publisher

    def take(self, topic: str, sequence: int) -> int:
        """Return how many messages are missing right before this one; sequence 0: not known."""
        self.received[topic] += 1
        return self.skip(topic, sequence)

    def skip(self, topic: str, sequence: int) -> int:
        """The same for a message that came and was dropped: that is counted elsewhere."""
        missing = 0
        if sequence:
            last = self._last.setdefault(topic, set())
            if before := max((n for n in last if n < sequence), default=0):
                missing = sequence - before - 1
                last.remove(before)
            last.add(sequence)
        self.lost[topic] += missing
        return missing


class Unrecorded:
    """Counts requests that were answered but never came.

    Sequence numbers do not show them: several nodes publish requests.
    """

    def __init__(self) -> None:
        self._forgotten = 0
        self._came: dict[str, bool] = {}  # id: whether the request came, not only an answer

    @property
    def missing(self) -> int:
        """Return the number of requests that are missing so far; an answer may overtake its own."""
        return self._forgotten + list(self._came.values()).count(False)

    def go_on(self, before: 'Unrecorded') -> None:
        """Take over the requests that came `before`: their answers may still come."""
        self._came |= {id_: True for id_, came in before._came.items() if came}

    def take(self, id_: str, is_request: bool) -> None:
        """Note a request, or an answer to one, unless its id is empty or longer than LONGEST_ID."""
        if not id_ or len(id_) > LONGEST_ID:
            return
        self._came[id_] = self._came.pop(id_, False) or is_request
        if len(self._came) > MOST_REQUESTS:
            self._forgotten += not self._came.pop(next(iter(self._came)))


class StampGaps:
    """Counts images that were never sent, by holes in the regular rhythm of their stamps.

    An interval of k periods (k > 1.5) hides round(k) - 1 images. The period is the median of what
    the last 31 intervals say of it, so it stays true where most of them are holes; `rate_hz` is
    what it was meant to be, 0 where that is not known.
    """

    def __init__(self, rate_hz: float = 0.0) -> None:
        self.missing = 0
        self._last_ns = 0
        self._meant = [NS / rate_hz] * 31 if rate_hz else []
        self._intervals: deque[float] = deque(self._meant, maxlen=31)

    def take(self, stamp: int) -> int:
        """Return how many more images are missing, now that one of `stamp` (ns) has come."""
        interval = stamp - self._last_ns
        first, self._last_ns = not self._last_ns, stamp
        if first or interval <= 0:  # a source that began again
            self._intervals = deque(self._meant, maxlen=31)
            return 0
        self._intervals.append(interval)
        count = len(self._intervals)
        if count < KNOWN:
            return 0
        period = statistics.median(self._intervals)
        missing = 0
        for k in range(0 if count == KNOWN else count - 1, count):  # the first ones all at once
            holes = max(round(self._intervals[k] / period) - 1, 0)
            if self._intervals[k] > 1.5 * period:
                self._intervals[k] /= holes + 1
                missing += holes
        self.missing += missing
        return missing


class Selection:
    """Which messages are written: of topics `pictures` and `thinned` not all.

    `room` takes the size of a raw image, and returns whether there is room for it today.
    """

    def __init__(
        self,
        settings: RecorderSettings,
        pictures: Collection[str],
        thinned: Collection[str],
        room: Callable[[int], bool],
    ):
        self._ring = AroundSlips(settings.before_s, settings.after_s)
        self._around_slips = settings.images == 'around_slips'
        self._limiter = RateLimiter(settings.display_period_s)
        self._pictures, self._thinned, self._room = pictures, frozenset(thinned), room

    def take(self, item: 'BagMessage | Slipping') -> 'Iterator[BagMessage]':
        """Yield what is to be written now that `item` has come."""
        if isinstance(item, Slipping):
            yield from self._with_room(self._ring.slip(item))
        elif item.topic in self._pictures:
            yield from self._with_room(self._ring.image(item) if self._around_slips else [item])
        elif item.topic not in self._thinned or self._limiter.keep(item):
            yield item

    def _with_room(self, images: 'Iterable[BagMessage]') -> 'Iterator[BagMessage]':
        return (item for item in images if self._room(len(item.data)))


class Losses:
    """What came, what was lost on the way, and what could not be written, per topic."""

    def __init__(self, images: str, rhythm: Collection[str], rate_hz: float, requests: str):
        self.gaps = Gaps()
        self.requests = Unrecorded()
        self.unwritten: Counter[str] = Counter()  # for which there was no disk
        self._unstamped: Counter[str] = Counter()  # too short for a stamp, recorded unchanged
        self._images, self._rhythm = images, {topic: StampGaps(rate_hz) for topic in rhythm}
        self._requests = requests

    @property
    def lost(self) -> Counter[str]:
        """Return the number of messages that were sent but did not come, per topic."""
        return self.gaps.lost + Counter({self._requests: self.requests.missing})

    def count(self, item: 'BagMessage | Dropped') -> None:
        """Look for what is missing before a message that came, were it dropped or not."""
        if isinstance(item, Dropped):
            head = item.head
            self.gaps.skip(item.topic, item.sequence)
        else:
            head = item.data
            self.gaps.take(item.topic, item.sequence)
        if item.topic in self._rhythm:
            if stamp := stamp_ns(head):
                self._rhythm[item.topic].take(stamp)
            else:
                self._unstamped[item.topic] += 1

    def said(self, dropped: Mapping[str, int], time_jump_s: float) -> dict[str, str]:
        """Return it as it goes into the metadata of a bag."""
        missing = {topic: gaps.missing for topic, gaps in self._rhythm.items()}
        if self._images in missing:  # those that are known to be lost were taken
            missing[self._images] -= self.gaps.lost[self._images]
            missing[self._images] = max(missing[self._images], 0)
        counts: dict[str, Mapping[str, float]] = {
            'received': self.gaps.received,
            'lost_before_recorder': self.lost,
            'dropped_in_recorder': dropped,
            'stamp_gaps': missing,
        }
        if self._unstamped:
            counts['without_stamp'] = self._unstamped
        if time_jump_s:
            counts['time_jump_s'] = {'system clock': time_jump_s}
        return {name: json.dumps(value, sort_keys=True) for name, value in counts.items()}
