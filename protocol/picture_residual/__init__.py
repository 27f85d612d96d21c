"""The picture residual on the wire: what a source has that the drawn model does not show."""
