"""What every test shares: compiled kernels of this session's processes in one place."""

from __future__ import annotations

import os
from pathlib import Path

from services.runtime.state_dir import kernel_fingerprint

# Before numba is imported, here and in every process that a test starts.
os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(__file__).parents[1] / ".numba" / kernel_fingerprint()))
