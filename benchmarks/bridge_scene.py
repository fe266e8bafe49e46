"""Speaker and bridge on a train, bridge and listener in the cloud, each a process on its host."""

from __future__ import annotations

import asyncio
import json
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from pathlib import Path
from typing import Self

from benchmarks.host_processes import PATIENCE_S, end, line, running
from benchmarks.two_hosts import Hosts

SLOWEST_HZ = 3.0
"""Of what is spoken and waited for."""


class Heard:
    """What the cloud has heard so far."""

    def __init__(self) -> None:
        """Nothing yet."""
        self.numbers: dict[str, list[int]] = {"events": [], "bulk": []}
        self.event_ages_s: list[float] = []

    async def listen(self, listener: asyncio.subprocess.Process) -> None:
        """Take in what the listener says, until it ends."""
        assert listener.stdout is not None  # noqa: S101 - `running` has piped it
        while text := await listener.stdout.readline():
            kind, number, age_s = json.loads(text)
            self.numbers[kind].append(number)
            if kind == "events":
                self.event_ages_s.append(age_s)

    async def until(self, kind: str, count: int) -> None:
        """Wait for so many. Raises TimeoutError with what is missing."""
        try:
            async with asyncio.timeout(PATIENCE_S + count / SLOWEST_HZ):
                while len(self.numbers[kind]) < count:  # noqa: ASYNC110 - another process brings it
                    await asyncio.sleep(0.05)
        except TimeoutError:
            missing = sorted(set(range(count)) - set(self.numbers[kind]))
            msg = f"{len(missing)} {kind} of {count} never came: {missing[:20]} …"
            raise TimeoutError(msg) from None


class Scene:
    """Everything that runs; a context."""

    def __init__(self, hosts: Hosts, folder: Path) -> None:
        """Start nothing yet; spool and journal lie in `folder`."""
        self.hosts = hosts
        self.folder = folder
        self.heard = Heard()
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> Self:
        """Begin."""
        await self._stack.__aenter__()
        return self

    async def __aexit__(self, *what: object) -> None:
        """End every process."""
        await self._stack.aclose()

    async def start(self, events_hz: float, bulk_hz: float) -> None:
        """Let everyone begin; the speaker when the bridges listen."""
        cloud = f"tcp/{self.hosts.addresses[self.hosts.cloud]}:7447"
        train = "tcp/127.0.0.1:7447"
        roles = str(Path(__file__).with_name("bridge_host_roles.py"))
        enter = self._stack.enter_async_context
        listener = await enter(running(self.hosts.cloud, roles, "listen", cloud))
        await enter(self._bridge(self.hosts.cloud, "cloud", "C1", "receives = true"))
        far = f'far = {{ name = "C1" }}\nuplink = {{ connect = ["{cloud}"] }}'
        await enter(self._bridge(self.hosts.train, "train", "T1", far))
        if await line(listener) != "ready":
            raise RuntimeError
        listening = asyncio.create_task(self.heard.listen(listener))
        self._stack.callback(listening.cancel)
        self.speaker = await enter(running(self.hosts.train, roles, "speak", train, str(events_hz), str(bulk_hz)))
        if await line(self.speaker) != "ready":
            raise RuntimeError

    def spool(self) -> Path:
        """The train's."""
        return self.folder / "T1" / "spool.sqlite"

    def journal(self) -> Path:
        """The cloud's."""
        return self.folder / "C1" / "journal.sqlite"

    def _bridge(
        self, host: str, kind: str, name: str, settings: str
    ) -> AbstractAsyncContextManager[asyncio.subprocess.Process]:
        profile = self.folder / f"{name}.toml"
        profile.write_text(
            f'[place]\nline = "demo"\nkind = "{kind}"\nname = "{name}"\n'
            f'[bus]\nconnect = ["tcp/127.0.0.1:7447"]\n'
            f'[lte_bridge]\nfolder = "{self.folder}/{name}"\n{settings}\n',
            "utf-8",
        )
        return running(host, "-m", "services.cli", "run", "lte_bridge", "--config", str(profile))

    async def silence(self) -> dict[str, int]:
        """Let the speaker end; how much it has said."""
        end(self.speaker)
        counts: dict[str, int] = await line(self.speaker)
        return counts
