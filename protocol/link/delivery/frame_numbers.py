"""Numbers of frame packets at the decoder's end of a link: which are new, late, twice, missing."""

from collections import deque
from dataclasses import dataclass
from itertools import combinations
from statistics import median

from protocol.limits import SEQUENCE_MODULUS
from protocol.link.messages import MAX_MISSING, MAX_NUMBER

# A packet may be so far ahead of the newest; any other is behind it.
MAX_AHEAD = 40
# Numbers behind the newest that are known to have come or not, and of which the loss is a share.
WINDOW, LOSS_WINDOW = 48, 32
# A missing packet is asked for so long after it was noticed, then again and again until it is
# given up; one that has not been missed by a later packet only so often.
ASK_AFTER_S, ASK_AGAIN_S, GIVE_UP_S = 0.03, 0.13, 2.5
MAX_EARLY_ASKS = 8
# How many packets are expected at a time, and how often before that is known.
MAX_EXPECTED, USUAL_INTERVAL_S = 4, 0.32
# On a link that loses more than this share, or before so many packets have told, each question goes
# out twice, so soon one after another.
LOSSY, TELLING, TWICE_S = 0.1, 8, 0.03
# How late a packet is when it is asked for without a later one.
LATE_S = 0.06
# Without loss a packet that is missing is in a queue, or was dropped there.
RELIABLE_ASK_AFTER_S = 0.6
# The interval between packets is measured over so many.
INTERVAL_WINDOW = 8
# After a longer gap the packets missing are not asked for: prediction has healed without them; the
# newest are if none has come before.
MAX_ASKED_GAP, MAX_FIRST_GAP = 16, 20
# Numbers are certain again after such a silence only by a HELLO.
MIN_CERTAIN_S, MAX_CERTAIN_S, CERTAIN_INTERVALS = 1.5, 8.0, 16


@dataclass(slots=True)
class _Missing:
    since_s: float
    asked_s: float = float("-inf")
    first_asked_s: float = float("inf")
    asks: int = 0
    is_early: bool = False


class FrameNumbers:
    """The full numbers of one session's frame packets.

    next_number: of the packet after those sent so far.
    newest, newest_s: number and time of the newest packet, and is_certain: whether they tell the
        number of the next one.
    """

    def __init__(self, next_number: int) -> None:
        self._begin = next_number
        self._begin_s = float("-inf")
        self.newest, self.newest_s = next_number - 1, float("-inf")
        self.is_certain = True
        self._come: set[int] = set()
        self._missing: dict[int, _Missing] = {}
        self._firsts: deque[bool] = deque(maxlen=LOSS_WINDOW)
        self._times: deque[tuple[int, float]] = deque(maxlen=INTERVAL_WINDOW)
        self._round_s = ASK_AGAIN_S
        self._round_trip_s = 0.0
        self._interval_s: float | None = None  # from one packet to the next, of late
        self._first_due_s = float("inf")  # when packet 0 would have been due
        self._unevenness_s = 0.0

    @property
    def loss(self) -> float:
        """Share of the packets of late that did not come the first time."""
        return 1 - sum(self._firsts) / len(self._firsts) if self._firsts else 0.0

    @property
    def certain_s(self) -> float:
        """After what silence numbers are not certain."""
        interval_s = self._interval_s or MAX_CERTAIN_S
        return min(max(CERTAIN_INTERVALS * interval_s, MIN_CERTAIN_S), MAX_CERTAIN_S)

    def synchronise(self, next_number: int, now_s: float) -> None:
        """The encoder has said which packet is next."""
        self.is_certain = True
        if next_number > self.newest + 1:
            self._miss(self.newest + 1, next_number, now_s)
            self.newest = next_number - 1

    def take(self, byte: int, now_s: float) -> int | None:
        """The number of a packet that begins with `byte`; None: it is not new."""
        ahead = (byte - self.newest) % SEQUENCE_MODULUS
        is_behind = ahead > MAX_AHEAD or self.newest + ahead - SEQUENCE_MODULUS in self._missing
        number = self.newest + (ahead - SEQUENCE_MODULUS if is_behind else ahead)
        if number < self._begin or number in self._come or number <= self.newest - WINDOW:
            return None
        if number > MAX_NUMBER:
            return None
        self._note(number, now_s)
        if number > self.newest:
            self._miss(self.newest + 1, number, now_s)
            self.newest, self.newest_s = number, now_s
            self._come = {each for each in self._come if each > number - WINDOW}
        self._come.add(number)
        return number

    def begin(self, now_s: float) -> None:
        """Frame packets may come from now on."""
        self._begin_s = now_s
        if not self._times:
            self._first_due_s = now_s - USUAL_INTERVAL_S * (self._begin - 1)

    def learn_round_trip(self, seconds: float) -> None:
        """No question is answered sooner."""
        self._round_trip_s = seconds
        self._round_s = max(self._round_s, 1.3 * seconds)

    def pass_by(self, number: int, now_s: float) -> None:
        """A packet has come by another way, which delivers all of them in order."""
        self._missing.clear()
        self.newest, self.newest_s = max(self.newest, number), now_s

    def awaits_below(self, number: int) -> bool:
        """Whether packets before `number` are missing and not given up."""
        return any(missing < number for missing in self._missing)

    def to_ask(self, now_s: float, is_reliable: bool) -> tuple[int, ...]:
        """The packets to ask for now, ascending."""
        self._expect(now_s, is_reliable)
        after_s = RELIABLE_ASK_AFTER_S if is_reliable else ASK_AFTER_S
        asked = list[int]()
        for number, missing in sorted(self._missing.items()):
            if now_s - missing.since_s > GIVE_UP_S:
                del self._missing[number]
                if not missing.is_early:
                    self._firsts.append(False)
            elif missing.is_early and missing.asks >= MAX_EARLY_ASKS:
                continue
            elif now_s >= missing.since_s + after_s and now_s >= self._ask_again_s(missing):
                asked.append(number)
        asked = asked[-MAX_MISSING:]
        for number in asked:
            self._missing[number].asked_s = now_s
            self._missing[number].first_asked_s = min(self._missing[number].first_asked_s, now_s)
            self._missing[number].asks += 1
        return tuple(asked)

    def _ask_again_s(self, missing: _Missing) -> float:
        is_lossy = self.loss > LOSSY or len(self._firsts) < TELLING
        is_first_of_two = missing.asks % 2 and is_lossy
        return missing.asked_s + (TWICE_S if is_first_of_two else self._round_s)

    def _note(self, number: int, now_s: float) -> None:
        """Learn from a packet that has come."""
        missing = self._missing.pop(number, None)
        answer_s = float("inf") if missing is None else now_s - missing.first_asked_s
        is_answer = missing is not None and missing.asks > 0 and answer_s >= self._round_trip_s
        self._firsts.append(not is_answer)
        if is_answer and missing is not None and missing.asks == 1:
            # How long a question and its answer take, a little more.
            least_s = max(ASK_AGAIN_S, 1.3 * self._round_trip_s)
            self._round_s = min(max(1.3 * answer_s, least_s), GIVE_UP_S / 2)
        if number > self.newest:
            self._learn_times(number, now_s, missing is None)

    def _learn_times(self, number: int, now_s: float, is_unasked: bool) -> None:
        """Learn when packets are due, by medians: a quarter of them may have come late."""
        if is_unasked and self._interval_s is not None:
            uneven_s = abs(now_s - self._due_s(number))
            self._unevenness_s += 0.2 * (uneven_s - self._unevenness_s)
        self._times.append((number, now_s))
        pairs = list(combinations(self._times, 2))
        if pairs:
            self._interval_s = median((b[1] - a[1]) / (b[0] - a[0]) for a, b in pairs)
        interval_s = self._interval_s or USUAL_INTERVAL_S
        self._first_due_s = median(at_s - interval_s * n for n, at_s in self._times)

    def _due_s(self, number: int) -> float:
        """When a packet is due; infinity: not known."""
        return self._first_due_s + (self._interval_s or USUAL_INTERVAL_S) * number

    def _miss(self, first: int, end: int, now_s: float) -> None:
        longest = MAX_ASKED_GAP if self._come else MAX_FIRST_GAP
        if end - first > longest:
            self._firsts.extend([False] * min(end - first, LOSS_WINDOW))
            if self._come:
                return
            first = end - longest
        for number in range(first, end):
            known = self._missing.get(number)
            self._missing[number] = _Missing(now_s) if known is None else known
            self._missing[number].is_early = False

    def _expect(self, now_s: float, is_reliable: bool) -> None:
        """Miss the next packets once they are late."""
        if is_reliable or not self.is_certain:
            return
        if now_s - max(self.newest_s, self._begin_s) > GIVE_UP_S:
            return
        late_s = LATE_S + 2 * self._unevenness_s
        for expected in range(self.newest + 1, self.newest + 1 + MAX_EXPECTED):
            if now_s < self._due_s(expected) + late_s:
                return
            if expected not in self._missing:
                self._missing[expected] = _Missing(now_s - ASK_AFTER_S, is_early=True)
