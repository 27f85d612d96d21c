"""The wire: bytes in, dataclasses out.  No I/O except in `link_zenoh`."""
