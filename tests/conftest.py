"""What every test shares: one place for compiled kernels, and property tests whose examples no clock judges."""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis

from services.runtime.state_dir import kernel_fingerprint

# Before numba is imported, here and in every process that a test starts.
os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(__file__).parents[1] / ".numba" / kernel_fingerprint()))

# How long an example takes tells of the machine and of kernels that compile, not of what is tested.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")
