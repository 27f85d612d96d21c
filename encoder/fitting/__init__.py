"""Parameters of the model that explain landmarks and pictures."""
