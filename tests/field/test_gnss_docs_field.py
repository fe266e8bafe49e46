"""Commands in docs/gnss_correction.md print what stands there. KIROTEI_FIELD_DATA names the folder that holds gnss/."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs" / "gnss_correction.md"
ROOT = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent"))
BASH = shutil.which("bash") or ""
pytestmark = pytest.mark.skipif(
    not (BASH and (ROOT / "gnss").is_dir()), reason="KIROTEI_FIELD_DATA names no folder with gnss/, or there is no bash"
)


def blocks(section: str) -> list[str]:
    """Fenced blocks of a section, in order."""
    text = DOCS.read_text("utf-8")
    after = text[text.index(f"## {section}\n") :]
    end = after.find("\n## ", 1)
    return re.findall(r"^```\n(.*?)^```$", after[:end] if end > 0 else after, flags=re.MULTILINE | re.DOTALL)


def printed_by(commands: str, folder: Path) -> str:
    """What commands print, run where nothing else is."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    berlin = str(ROOT / "gnss" / "berlin_5hz")
    done = subprocess.run(
        [BASH, "-euo", "pipefail", "-c", commands],
        cwd=folder,
        env={**os.environ, "PATH": path, "DATA": berlin},
        capture_output=True,
        text=True,
        check=True,
        timeout=240,
    )
    return done.stdout


@pytest.mark.parametrize(
    ("section", "commands", "output"),
    [
        # The paper's methods alone: each pair is a block of commands and the one that they print.
        ("Berlin", 0, 1),
        ("The paper's tables with and without a base", 2, 3),
    ],
    ids=["Berlin", "static"],
)
def test_the_commands_print_what_the_docs_say(section: str, commands: int, output: int, tmp_path: Path) -> None:
    given = blocks(section)
    assert "kirotei gnss evaluate" in given[commands]
    assert "Table 2: fixation rate" in given[output]
    assert printed_by(given[commands], tmp_path).endswith(given[output])
