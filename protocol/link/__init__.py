"""Packets between hosts.  Two files import zenoh."""
