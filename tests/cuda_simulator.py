"""Scripts in numba-cuda's simulator, which is chosen as a process begins."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def found_by(script: Path, vehicle: Path) -> dict[str, Any]:
    """What a script found with a vehicle file: its last line, which is JSON."""
    done = subprocess.run(
        [sys.executable, script, vehicle],
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"},
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
