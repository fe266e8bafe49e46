"""The supervisor over services of tests/wire/lives.py: `python -m tests.wire.lives_up PROFILE NAME…`.

A NAME with a slash is a program of its own.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from services.runtime.child_process import ChildPlan
from services.runtime.config import load_host
from services.runtime.supervisor import run_supervisor

if __name__ == "__main__":
    _, file, *names = sys.argv
    lives = (sys.executable, "-m", "tests.wire.lives")
    commands = {name: (name,) if "/" in name else (*lives, name, file) for name in names}
    plans = tuple(ChildPlan(name, command) for name, command in commands.items())
    run_supervisor(load_host(Path(file), os.environ), plans)
