"""Draws pictures of people who do not exist, with their landmarks, to train an AAM on."""
