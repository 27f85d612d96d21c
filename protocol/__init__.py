"""The wire: bytes in, dataclasses out.  No I/O except call files and `link.zenoh_link`."""
