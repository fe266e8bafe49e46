"""The bus of a train and a cloud, each on a host of its own, and a link between them that fails."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from benchmarks.host_processes import end, line, running
from benchmarks.two_hosts import Hosts
from tests.wire.stage import within

pytestmark = pytest.mark.hosts
ROLES = str(Path(__file__).with_name("bus_roles.py"))
CUT_S = 3.0


class Heard:
    """What the reader has told so far."""

    def __init__(self, reader: asyncio.subprocess.Process) -> None:
        self.reader = reader
        self.sequences: dict[str, list[int]] = {"truth": [], "gnss": [], "event": []}
        self.totals: dict[str, list[int]] = {}

    async def listen(self) -> None:
        """Take in everything until the reader has given its totals."""
        while True:
            said = await line(self.reader)
            if isinstance(said, dict):
                self.totals = said
                return
            assert isinstance(said, list)
            self.sequences[said[0]].append(said[1])


async def test_a_link_that_is_cut_for_three_seconds(hosts: Hosts) -> None:
    inside, between = "tcp/127.0.0.1:7447", f"tcp/{hosts.addresses[hosts.cloud]}:7447"
    async with (
        running(hosts.cloud, ROLES, "router", between) as cloud_router,
        running(hosts.train, ROLES, "router", inside, between) as train_router,
        running(hosts.cloud, ROLES, "read", between) as reader,
    ):
        for process in (cloud_router, train_router, reader):
            assert await line(process) == "ready"
        # What the reader wants has to have come to the train's router: this test is of a cut, not of a start.
        await asyncio.sleep(1.0)
        async with running(hosts.train, ROLES, "write", inside) as writer:
            heard = Heard(reader)
            listening = asyncio.create_task(heard.listen())
            await asyncio.sleep(2.5)
            hosts.cut()
            await asyncio.sleep(CUT_S)
            before = {topic: list(sequences) for topic, sequences in heard.sequences.items()}
            hosts.mend()
            await asyncio.sleep(4.0)
            end(writer)
            count = await line(writer)
            assert isinstance(count, int)
            await within(writer.wait(), 20.0)
            end(reader)
            await within(listening, 20.0)

    assert all(before.values()), "nothing came before the cut"
    events, states, stream = (heard.sequences[topic] for topic in ("event", "gnss", "truth"))
    # EVENT: every one, once, in order.
    assert events == list(range(count))
    assert heard.totals["event"] == [0, 0]
    # STATE: cut short and caught up with.
    assert states[-1] == count - 1
    assert max(before["gnss"]) < count - 100
    # STREAM: what was lost in the cut (the sockets' buffers hold some of it) is seen to be, and nothing came twice.
    missing, _ = heard.totals["truth"]
    assert missing == stream[-1] - stream[0] + 1 - len(stream)
    assert stream[-1] == count - 1
