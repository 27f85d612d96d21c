"""What relays carry: CPU, memory, delay and loss, by the number of calls and of subscribers."""
