"""Calls at a relay, watched in browsers that are on no host of the call."""
