"""The voice on the receiving side: taken out of packets, decoded, put on the pictures' clock."""
