"""Search (thesis 3.1): the model fitted to a picture that it has not seen."""
