"""A train and a cloud in network namespaces of their own, and a link between them that fails."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest

from tests.wire.stage import within

ROLES = Path(__file__).with_name("namespace_roles.py")
ROOT = ROLES.parents[2]
CUT_S = 3.0
TRAIN, CLOUD = f"kirotei-t{os.getpid()}", f"kirotei-c{os.getpid()}"
LINK = "link0"
ADDRESSES = {TRAIN: "10.213.7.1", CLOUD: "10.213.7.2"}


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True, timeout=10)  # noqa: S607 - iproute2, wherever it is installed


@pytest.fixture
def namespaces() -> Iterator[None]:
    """Two namespaces joined by a virtual cable, taken down whatever happens."""
    if shutil.which("ip") is None:
        pytest.skip("network namespaces need iproute2")
    try:
        ip("netns", "add", TRAIN)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"network namespaces need privileges: {error.stderr.decode().strip()}")
    try:
        ip("netns", "add", CLOUD)
        ip("link", "add", LINK, "netns", TRAIN, "type", "veth", "peer", "name", LINK, "netns", CLOUD)
        for namespace, address in ADDRESSES.items():
            ip("-n", namespace, "address", "add", f"{address}/24", "dev", LINK)
            ip("-n", namespace, "link", "set", LINK, "up")
            ip("-n", namespace, "link", "set", "lo", "up")
        yield
    finally:
        for namespace in ADDRESSES:
            with suppress(subprocess.CalledProcessError):
                ip("netns", "delete", namespace)


@asynccontextmanager
async def running(namespace: str, *role: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A role in a namespace; killed at the end when it has not ended by itself."""
    process = await asyncio.create_subprocess_exec(
        "ip",
        *("netns", "exec", namespace, sys.executable, str(ROLES), *role),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        cwd=ROOT,
        env=dict(os.environ) | {"PYTHONPATH": str(ROOT)},
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


async def line(process: asyncio.subprocess.Process) -> object:
    """The next value that a role prints."""
    assert process.stdout is not None
    text = await within(process.stdout.readline(), 20.0)
    assert text, "the role ended early"
    value: object = json.loads(text)
    return value


def end(process: asyncio.subprocess.Process) -> None:
    """Tell a role to end."""
    assert process.stdin is not None
    process.stdin.close()


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


@pytest.mark.usefixtures("namespaces")
async def test_a_link_that_is_cut_for_three_seconds() -> None:
    inside, between = "tcp/127.0.0.1:7447", f"tcp/{ADDRESSES[CLOUD]}:7447"
    async with (
        running(CLOUD, "router", between) as cloud_router,
        running(TRAIN, "router", inside, between) as train_router,
        running(CLOUD, "read", between) as reader,
    ):
        for process in (cloud_router, train_router, reader):
            assert await line(process) == "ready"
        # What the reader wants has to have come to the train's router: this test is of a cut, not of a start.
        await asyncio.sleep(1.0)
        async with running(TRAIN, "write", inside) as writer:
            heard = Heard(reader)
            listening = asyncio.create_task(heard.listen())
            await asyncio.sleep(2.5)
            ip("-n", TRAIN, "link", "set", LINK, "down")
            await asyncio.sleep(CUT_S)
            before = {topic: list(sequences) for topic, sequences in heard.sequences.items()}
            ip("-n", TRAIN, "link", "set", LINK, "up")
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
