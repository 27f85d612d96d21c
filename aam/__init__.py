"""The statistical AMB AAM (thesis 2.4 and 3): annotate, train and search over many people."""
