"""`kirotei cloud learn` and `analyse` on the bus: one task, one answer when it is done."""

from __future__ import annotations

import sys
from typing import NoReturn

import msgspec

from schemas.bridge import HistoryTask, HistoryTaskDone
from schemas.queries import HISTORY_TASK
from schemas.topic import Place
from services.recorder.bus_session_command import BusSession
from services.runtime.question import NoAnswerError, RefusedError
from services.runtime.zenoh_node import ZenohNode

PATIENCE_S = 3600.0
"""The cloud goes on and keeps what comes of it, also when nobody waits any more."""


def run_task(task: HistoryTask, place: Place, shard: str, endpoint: str, *, as_json: bool) -> NoReturn:
    """Ask, wait, tell, and end the process."""
    name = "cloud analyse" if task.task == "analyse" else "cloud learn"

    async def work(node: ZenohNode) -> int:
        try:
            done = await node.ask(HISTORY_TASK, place, task, timeout_s=PATIENCE_S, shard=shard)
        except (NoAnswerError, RefusedError) as error:
            sys.stderr.write(f"kirotei {name}: {error}\n")
            return 1
        if as_json:
            sys.stdout.write(msgspec.json.encode(done).decode() + "\n")
        else:
            _tell(task, done)
        if done.partial:
            sys.stderr.write(f"kirotei {name}: PARTIAL: {done.partial}\n")
        return 0

    BusSession(name.replace(" ", "-"), place, endpoint, work).run()


def _tell(task: HistoryTask, done: HistoryTaskDone) -> None:
    rate = done.false_alarm_rate
    held_out = "" if rate is None else f"; held out {rate:.2%} false alarms"
    if task.task == "analyse":
        sys.stdout.write(f"{done.passes} passes by model {done.model}: {done.events} words of events{held_out}\n")
        sys.stdout.write(f"see: kirotei cloud history reanalysed --model {done.model}\n")
    elif done.passes:
        sys.stdout.write(f"model {done.model} from {done.passes} passes{held_out}\n")
        if done.analysis:
            sys.stdout.write(f"{done.events} words of events on the way, as analysis {done.analysis}\n")
    else:
        sys.stdout.write("no passes to learn from in that time\n")
    for reason, count in done.left_out.items():
        sys.stderr.write(f"{count} measurements left out: {reason}\n")
