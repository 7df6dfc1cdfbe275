"""The runtime lives without torch: every module that it has imports where torch cannot be."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import importlib, pkgutil, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"torch", "sentence_transformers", "myo_sim"}:
            raise ImportError(f"{name} is no part of the runtime")

sys.meta_path.insert(0, Refuse())
count = 0
for room in ("configs", "flexmotion", "retarget", "drivers", "streamer"):
    package = importlib.import_module(room)
    for module in pkgutil.walk_packages(package.__path__, f"{room}."):
        if not module.name.startswith(TRAINING):
            importlib.import_module(module.name)
            count += 1
print(count)
"""

TRAINING: tuple[str, ...] = ("flexmotion.training",)
"""Modules that only training imports."""


def test_no_runtime_module_imports_torch() -> None:
    script = f"TRAINING = {TRAINING!r}\n{SCRIPT}"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 50
