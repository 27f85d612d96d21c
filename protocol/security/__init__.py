"""Who may take part in a call: invitations, and the encryption of its packets."""
