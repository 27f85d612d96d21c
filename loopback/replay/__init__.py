"""Suites of recorded clips with thresholds: what a CI runs to see that nothing got worse."""
