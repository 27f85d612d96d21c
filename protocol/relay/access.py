"""The access list of a relay, in the form that Zenoh takes.

A call has two keys, see `call_keys`: its caller sends on one, its viewers on the other.
Certificates tell the peers apart; a peer on no list can do nothing.
"""

from collections.abc import Iterable
from typing import Any

from protocol.link.direction import direction_key
from protocol.link.presence import WHO_KEY, call_keys
from protocol.security.authority import RELAY_NAME, InvitedPeer, PeerRole

# Who holds the relay's own keys: other relays of the owner pass everything on, and the owner may
# ask which calls there are.
_OWNER_RULES = [
    {
        "id": "pass on",
        "permission": "allow",
        "flows": ["ingress", "egress"],
        "messages": ["put", "declare_subscriber"],
        "key_exprs": list(call_keys("*", is_encoder=True)),
    },
    {
        "id": "list calls",
        "permission": "allow",
        "flows": ["ingress", "egress"],
        "messages": ["query", "reply"],
        "key_exprs": ["@/*/router/subscriber/**"],
    },
]


def access_control(peers: Iterable[InvitedPeer]) -> dict[str, Any]:
    """Zenoh's section `access_control`: only the caller of a call publishes it, only its viewers
    receive it and answer, both may ask who is there; who was revoked, or never invited, nothing.
    """
    allowed = [peer for peer in peers if not peer.revoked]
    rules_of = {peer.name: _rules(peer) for peer in allowed} | {RELAY_NAME: _OWNER_RULES}
    rules = {rule["id"]: rule for rules in rules_of.values() for rule in rules}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": list(rules.values()),
        "subjects": [{"id": name, "cert_common_names": [name]} for name in rules_of],
        "policies": [
            {"rules": [rule["id"] for rule in its_rules], "subjects": [name]}
            for name, its_rules in rules_of.items()
        ],
    }


def _rules(peer: InvitedPeer) -> list[dict[str, Any]]:
    """What a peer may publish and subscribe to, and what may be passed on to it."""
    sent, received = call_keys(peer.call, peer.role is PeerRole.CALLER)
    # The two directions of one call are two calls here, and settle which is whose.
    settled = direction_key(peer.call.removesuffix("-a").removesuffix("-b"))
    return [
        _rule(peer, "ingress", "put", sent, WHO_KEY, settled),
        _rule(peer, "ingress", "declare_subscriber", received, settled),
        _rule(peer, "egress", "put", received, settled),
        _rule(peer, "egress", "declare_subscriber", sent, settled),
    ]


def _rule(peer: InvitedPeer, flow: str, message: str, *keys: str) -> dict[str, Any]:
    return {
        "id": f"{peer.call}/{peer.role}/{flow}/{message}",
        "permission": "allow",
        "flows": [flow],
        "messages": [message],
        "key_exprs": list(keys),
    }
