"""`kirotei replay --live`: a recording onto the bus."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import NoReturn

from services.recorder.bus_session_command import BusSession
from services.recorder.live_replay import Played, ReplayConfig, first_address, play_apart, senders
from services.recorder.offline_replay import REPLAY_INSTANCE
from services.recorder.progress_command import ProgressLine
from services.recorder.recording_file import lanes_in_summary, read_recording
from services.runtime.key_expression import intersects
from services.runtime.node import Sample
from services.runtime.zenoh_node import ZenohNode

BEHIND_TOLD_S = 0.5


def run_live_replay(
    file: Path, key_expression: str | None, endpoint: str, config: ReplayConfig, *, as_json: bool
) -> NoReturn:
    """Replay until the end or Ctrl-C; ends the process. Raises TopicError when nothing can be replayed."""
    with file.open("rb") as stream:
        lanes = [
            lane
            for lane in lanes_in_summary(stream).values()
            if key_expression is None or intersects(key_expression, lane.key)
        ]
    place = first_address(lanes, config.line).place
    samples = read_recording(file, key_expression)
    original = senders(lanes, config.line)

    async def work(node: ZenohNode) -> int:
        return await _play(node, samples, original, config, as_json=as_json)

    BusSession(REPLAY_INSTANCE, place, endpoint, work, speaks=True).run()


async def _play(
    node: ZenohNode, samples: Iterator[Sample], original: set[str], config: ReplayConfig, *, as_json: bool
) -> int:
    line = ProgressLine(time.monotonic)
    started_s = time.monotonic()
    played = await play_apart(node, samples, original, config, lambda now: line.update(partial(_progress, now)))
    line.done()
    elapsed_s = time.monotonic() - started_s
    if as_json:
        result = {
            "source": node.source,
            "published": played.published,
            "without_topic": played.without_topic,
            "duration_s": round(elapsed_s, 3),
            "stopped": node.stopping,
        }
        sys.stdout.write(json.dumps(result, indent=2) + "\n")
    else:
        left_out = f", {played.without_topic} without a topic left out" if played.without_topic else ""
        end = ", stopped" if node.stopping else ""
        words = f"{played.published} messages published as {node.source} in {elapsed_s:.1f} s{left_out}{end}"
        sys.stdout.write(f"{words}\n")
    return 0


def _progress(played: Played) -> str:
    when = datetime.fromtimestamp(played.time_ns // 1_000_000_000, UTC)
    behind = f", {played.behind_s:.1f} s behind" if played.behind_s > BEHIND_TOLD_S else ""
    return f"{when:%Y-%m-%d %H:%M:%S}: {played.published} messages{behind}"
