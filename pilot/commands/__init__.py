"""The command lines of the scripts next to the package: options, messages and exit codes."""
