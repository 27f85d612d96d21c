"""How a call goes, told to its page and in the terminal."""

from collections.abc import Callable
from dataclasses import replace
from time import monotonic

from protocol.limits import DEFAULT_CALL
from protocol.link.interface import LinkOptions, Reachability
from risorius.call_page.page_clock import PageClock
from risorius.call_page.page_server import PageServer
from risorius.live_call.call_words import cost_words, delay_ms, state_words, stranger_words
from risorius.live_call.messages import WARMING_UP, Presence, Receiving, Sending


class CallStatus:
    """What is known of a call.

    say: called with a line when the other end comes, is lost, or leaves, and once of strangers.
    sending, receiving: the newest; None: nothing is known yet.
    has_picture: the other person has been seen since they came.
    person: the name that they have said, or ""; is_muted: their microphone is off.
    """

    def __init__(
        self, page: PageServer, clock: PageClock, link: LinkOptions, say: Callable[[str], None]
    ) -> None:
        self._page, self._clock, self._link, self._say = page, clock, link, say
        self.sending: Sending | None = None
        self.receiving: Receiving | None = None
        self.has_picture = False
        self.person, self.is_muted = "", False
        self._start_s = monotonic()
        self._said = ""  # the newest state
        self._was_alone = False  # since the other end has left
        self._has_told_of_strangers = False

    @property
    def is_refused(self) -> bool:
        """Whether the other end is in a call with somebody else."""
        return self.sending is not None and self.sending.reach == Reachability.BUSY

    def tell(self) -> None:
        """Tell pages how it goes, and the terminal what has changed."""
        sending, receiving = self.sending, self.receiving
        presence = Presence.AWAITED if receiving is None else receiving.presence
        name, is_listening = self._link.call, bool(self._link.listen)
        is_camera_off = receiving is not None and receiving.is_camera_off
        reached = self._reached(presence)
        state = self.person or name, is_listening, self.has_picture, reached, presence
        waited_s = monotonic() - self._start_s
        words = state_words(*state, is_camera_off, waited_s, knows_person=bool(self.person))
        self._page.tell(
            "state",
            name=self.person or ("" if name == DEFAULT_CALL else name),
            text=words.text,
            over=words.over,
            trouble=words.is_trouble,
            muted=self.is_muted and self.has_picture,
        )
        news = words.text or "is here"
        # The first one is how every call begins.
        if self._said and news != self._said:
            self._say(f"{self.person or name}: {news}")
        self._said = news
        begun_s = None if sending is None else sending.begun_s
        self._page.tell(
            "costs",
            text=cost_words(sending, receiving) or WARMING_UP,
            delay_ms=delay_ms(sending, receiving),
            begun_ms=None if begun_s is None else self._clock.page_ms(begun_s),
            fps=None if sending is None else sending.fps,
        )

    def _reached(self, presence: Presence) -> Sending | None:
        """`sending`; a peer whose call has ended is gone, until there is one again."""
        sending = self.sending
        has_peer = sending is not None and sending.reach == Reachability.HAS_PEER
        self._was_alone = presence is Presence.LEFT and (self._was_alone or not has_peer)
        if sending is None or presence is not Presence.LEFT or self._was_alone:
            return sending
        return replace(sending, reach=Reachability.NO_PEER)

    def tell_of_strangers(self) -> None:
        """Say once that a stranger is there, though each direction of the call notices them."""
        if not self._has_told_of_strangers:
            self._has_told_of_strangers = True
            text = stranger_words(bool(self._link.listen))
            self._page.tell("trouble", text=text)
            self._say(text)
