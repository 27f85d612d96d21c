"""Measures how late a live call is seen and heard."""
