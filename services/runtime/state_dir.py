"""Where a host keeps state and compiled kernels."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Mapping, MutableMapping
from pathlib import Path

SERVICES = Path(__file__).parents[1]
KEPT_FINGERPRINTS = 3
_IMPORTED = re.compile(rb"^from (services[\w.]+) import", re.MULTILINE)
VARIABLE = "KIROTEI_STATE_DIR"
"""Environment variable by which the runtime tells its services where state is kept."""


def state_dir(environment: Mapping[str, str], configured: str | None = None) -> Path:
    """Folder for state: as configured, as handed on, as systemd gives it, or the user's own.

    `$STATE_DIRECTORY` is what systemd makes for `StateDirectory=`; the last resort is
    `$XDG_STATE_HOME/kirotei` (XDG Base Directory 0.8), by default ~/.local/state/kirotei.
    Nothing is created.
    """
    if configured:
        return Path(configured).expanduser()
    if environment.get(VARIABLE):
        return Path(environment[VARIABLE])
    if environment.get("STATE_DIRECTORY"):
        return Path(environment["STATE_DIRECTORY"].split(":")[0])
    if environment.get("XDG_STATE_HOME"):
        return Path(environment["XDG_STATE_HOME"]) / "kirotei"
    return Path(environment["HOME"] if environment.get("HOME") else "/var/lib") / ".local" / "state" / "kirotei"


def kernel_fingerprint() -> str:
    """Digest of every source file that holds kernels, and of the modules whose constants they take in.

    Numba looks for changes in a kernel's own file alone, not in those of what it calls: after
    an update a folder shared with older sources could give wrong figures.
    """
    sources = {path: path.read_bytes() for path in SERVICES.rglob("*.py")}
    kernels = {path for path, source in sources.items() if b"@kernel" in source or b"njit" in source}
    taken_in = {
        SERVICES.parent.joinpath(*module.decode().split(".")).with_suffix(".py")
        for path in kernels
        for module in _IMPORTED.findall(sources[path])
    }
    digest = hashlib.sha256()
    for path in sorted(kernels | (taken_in & sources.keys())):
        digest.update(sources[path])
    return digest.hexdigest()[:16]


def _forget_old(current: Path) -> None:
    """Remove kernels of sources that are gone, but for the newest few, which others may still run."""
    others = [path for path in current.parent.iterdir() if path.is_dir() and path != current]
    others.sort(key=lambda path: path.stat().st_mtime)
    for path in others[:-KEPT_FINGERPRINTS]:
        shutil.rmtree(path, ignore_errors=True)


def prepare(state: Path, environment: MutableMapping[str, str]) -> str | None:
    """Make the state folder and let numba keep compiled kernels in it; returns a warning, or None.

    Must come before numpy and numba are imported. Where the folder cannot be written, kernels go into
    a fresh temporary folder (compiled code is never read from a folder that others can
    write), and the warning says so. A `NUMBA_CACHE_DIR` set by the user is kept.
    """
    environment[VARIABLE] = str(state)
    # Several services share a host; matrices as small as ours are quicker on one thread than divided.
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
    if environment.get("NUMBA_CACHE_DIR"):
        return None
    kernels = state / "kernels" / kernel_fingerprint()
    try:
        (state / "kernels").mkdir(mode=0o700, parents=True, exist_ok=True)
        kernels.mkdir(mode=0o700, exist_ok=True)
        _forget_old(kernels)
    except OSError as error:
        problem = f"cannot make {kernels}: {error.strerror}"
    else:
        if os.access(kernels, os.W_OK | os.X_OK):
            environment["NUMBA_CACHE_DIR"] = str(kernels)
            return None
        problem = f"cannot write to {kernels}"
    environment["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="kirotei-kernels-")
    return f"{problem}; state is not kept and kernels are compiled anew at every start (set `state_dir`)"
