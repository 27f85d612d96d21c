"""Everything that needs both ends: the command line, benchmarks, replays, quality."""
