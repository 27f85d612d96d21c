"""Pages of this host: who may see them, and their server."""
