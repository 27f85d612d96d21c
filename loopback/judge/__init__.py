"""The judge: what a decoded video is worth beside its source, seen by programs of its own."""
