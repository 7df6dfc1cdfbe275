"""Exit codes of the command line (docs/architecture.md); an error carries its own, see `flexmotion.configs.errors`."""

OK = 0
CHECK_FAILED = 1
"""The command ran, and its check failed."""
BAD_USAGE = 2
HARDWARE_FAILED = 3
INTERRUPTED = 130
"""Interrupted by SIGINT: 128 plus the signal's number, as in shells."""
