"""The commands: options in, messages and exit codes out. The scripts beside the package only call them."""
