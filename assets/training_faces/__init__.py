"""Makes calls of people who do not exist, to train the probability model on."""
