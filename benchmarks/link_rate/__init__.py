"""What a call weighs on the wire between two hosts, with all headers, both ways."""
