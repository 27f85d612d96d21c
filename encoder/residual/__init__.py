"""The picture residual: source less drawn model, transformed, quantised and coded."""
