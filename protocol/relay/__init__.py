"""Relays: Zenoh's router with limits, and who may do what there."""
