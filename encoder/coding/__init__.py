"""From faces to the bytes of packets at a given rate."""
