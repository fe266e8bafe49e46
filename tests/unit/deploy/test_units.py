"""The systemd units say what systemd understands."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

UNITS = sorted((Path(__file__).parents[3] / "deploy" / "systemd").glob("*.service"))
ANALYZE = shutil.which("systemd-analyze")


@pytest.mark.skipif(ANALYZE is None, reason="systemd-analyze is not installed")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_finds_no_fault(unit: Path, tmp_path: Path) -> None:
    text = unit.read_text("utf-8")
    copy = tmp_path / unit.name.replace("@.", "@recorder.")
    # systemd insists that the program exists; here it is not installed under /opt.
    copy.write_text(
        text.replace("/opt/kirotei/bin/kirotei", sys.executable).replace("/opt/kirotei/bin/python", sys.executable)
    )
    command = [str(ANALYZE), "verify", "--man=no", str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert [line for line in done.stderr.splitlines() if "kirotei" in line] == []
    assert done.returncode == 0


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_units_are_notified_watched_and_restarted(unit: Path) -> None:
    lines = unit.read_text("utf-8").splitlines()
    assert "Type=notify" in lines
    assert any(line.startswith("WatchdogSec=") for line in lines)
    assert any(line in ("Restart=on-failure", "Restart=always") for line in lines)
    assert "NoNewPrivileges=yes" in lines
    assert "ProtectSystem=strict" in lines
