"""Exit codes of the command line (docs/architecture.md); an error carries its own, see `flexmotion.configs.errors`."""

OK = 0
CHECK_FAILED = 1
"""It ran, and what it checked is not as it should be."""
BAD_USAGE = 2
HARDWARE_FAILED = 3
INTERRUPTED = 130
"""By SIGINT, as shells count it: 128 and the signal's number."""
