"""`kirotei warm-up` compiles what every method needs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

KIROTEI = str(Path(sys.executable).with_name("kirotei"))


def test_every_method_is_compiled() -> None:
    done = subprocess.run([KIROTEI, "warm-up"], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "Done" in done.stdout


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    environment = {"KIROTEI_STATE_DIR": str(tmp_path / "file"), "NUMBA_CACHE_DIR": "", "PATH": ""}
    done = subprocess.run(
        [KIROTEI, "warm-up"], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert f"{tmp_path}/file" in done.stderr
