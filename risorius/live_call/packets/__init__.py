"""What happens to the packets of a call on their way: counted, stamped, recorded."""
