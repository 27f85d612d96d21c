"""Pose, actuators and identity fitted to landmarks and to pictures."""
