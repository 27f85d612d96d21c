"""What needs both ends: benchmarks, sweeps, replays, quality, reports."""
