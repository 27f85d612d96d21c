"""The voice on the sending side: sound in, speech frames out, put into frame packets."""
