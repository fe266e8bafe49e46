"""A recording process that is killed."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

from services.recorder.recording_file import read_recording
from services.recorder.recording_store import RecordingStore
from tests.unit.recorder.samples import truth_sample
from tests.unit.recorder.test_recording_store import settings

RECORDING = """
import itertools, sys
from pathlib import Path
from services.recorder.recording_store import RecordingStore
from tests.unit.recorder.samples import truth_sample
from tests.unit.recorder.test_recording_store import settings
store = RecordingStore(settings(Path(sys.argv[1])))
store.open()
for start in itertools.count(0, 50):
    store.write([truth_sample(start + index) for index in range(50)])
    store.flush()
    print(store.recorded, flush=True)
    store.write([truth_sample(10_000_000)])  # never flushed: is lost, or comes with the next flush
"""


def test_what_was_flushed_before_kill_9_is_all_there_after_the_next_start(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", RECORDING, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            flushed = int(line)
            if flushed > 1000:
                break
        process.send_signal(signal.SIGKILL)
        later = [int(line) for line in process.stdout if line.endswith("\n")]
    flushed = later[-1] if later else flushed
    store = RecordingStore(settings(tmp_path))
    (leftover,) = store.open()
    assert leftover.name.endswith(".mcap.part")
    told = store.repair_leftover(leftover)
    store.close()
    assert "repaired" in told
    (path,) = tmp_path.iterdir()
    samples = list(read_recording(path))
    # Between the last word of the process and its end another flush may have come through.
    assert flushed <= len(samples) <= flushed + 51
    numbered = [sample for sample in samples if sample != truth_sample(10_000_000)]
    assert numbered == [truth_sample(index) for index in range(len(numbered))]
