"""Packets between hosts.  One file imports zenoh."""
