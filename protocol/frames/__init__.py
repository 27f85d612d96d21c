"""Frame packets: quantised values, predicted from the decoded past."""
