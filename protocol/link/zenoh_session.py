"""What the ends of a link and a relay do alike with Zenoh: settings, errors, and who is there."""

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import zenoh
from zenoh.handlers import Callback

from protocol.link.messages import Role
from protocol.link.presence import WHO_KEY, call_keys, parse_presence, serialise_presence

# The attachment that tells an answer who is there from payloads of a call.
PRESENCE_MARK = b"p"


def zenoh_config(settings: Mapping[str, Any]) -> zenoh.Config:
    """Zenoh's configuration of settings by their names in it."""
    config = zenoh.Config()
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def reason(error: zenoh.ZError) -> str:
    """Zenoh's message without the source location."""
    return re.sub(r"\s+at \S+\.rs:\d+\.?", "", str(error))


def answer_who_is_there(session: zenoh.Session, role: Role, call: str) -> None:
    """Answer each question who is there, on the key that whoever asks subscribes to.

    role, call: what is answered; a relay has no call.  Runs in Zenoh's receiving threads.
    """

    def asked(sample: zenoh.Sample) -> None:
        found = parse_presence(sample.payload.to_bytes())
        if found is not None and found[0] is not Role.RELAY:
            _, key = call_keys(found[1], found[0] is Role.ENCODER)
            with suppress(zenoh.ZError):
                session.put(key, serialise_presence(role, call), attachment=PRESENCE_MARK)

    session.declare_subscriber(WHO_KEY, Callback(asked, indirect=False))
