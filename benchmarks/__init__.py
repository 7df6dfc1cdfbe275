"""Measurements of the project, run by hand: `python -m benchmarks` lists them (see `benchmarks/README.md`)."""
