"""Cases that layers cannot show, as a contact sheet."""
