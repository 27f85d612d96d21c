"""The command line: arguments, commands, progress, errors in one line."""
