"""Shortened runs of the scripts on the page about other learners."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "learners.md"
SCRIPTS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)


@pytest.mark.parametrize(
    ("script", "long", "short"),
    [
        (SCRIPTS[0], "STEPS = 100_000", "STEPS = 600"),
        (SCRIPTS[1], "1_000_000, 32\n", "512, 2\n"),
        (SCRIPTS[2], "400_000, 8, 256, 8", "1_200, 2, 300, 1"),
    ],
    ids=["Stable-Baselines3", "Stable-Baselines3, many vehicles", "CleanRL"],
)
def test_a_script_runs(script, long, short, capsys):
    assert long in script
    exec(compile(script.replace(long, short), str(PAGE), "exec"), {"__name__": "script"})
    assert capsys.readouterr().out
