"""Every module but those of training can be imported without torch."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import importlib, pkgutil, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"torch", "sentence_transformers", "myo_sim"}:
            raise ImportError(f"{name} does not belong to the runtime")

sys.meta_path.insert(0, Refuse())
import flexmotion
for module in pkgutil.walk_packages(flexmotion.__path__, "flexmotion."):
    if not module.name.startswith(TRAINING):
        importlib.import_module(module.name)
        print(module.name)
"""

TRAINING: tuple[str, ...] = ("flexmotion.training",)
"""Packages that only training imports."""
ROOMS = {"configs", "drivers", "human", "retarget", "sampling", "streamer"}


def test_no_runtime_module_imports_torch() -> None:
    script = f"TRAINING = {TRAINING!r}\n{SCRIPT}"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    names = result.stdout.split()
    assert len(names) > 150 and {name.split(".")[1] for name in names} >= ROOMS


def test_a_run_loads_neither_scipy_signal_nor_scipy_stats() -> None:
    """They took more than a third of the time until a run began."""
    script = "import sys, flexmotion.streamer.run.session; print({'scipy.signal', 'scipy.stats'} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert result.stdout == "set()\n", result.stderr
