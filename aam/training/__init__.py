"""Training (thesis 2.4.2 to 2.4.5): from annotations to a model."""
