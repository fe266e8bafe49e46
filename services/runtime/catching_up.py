"""Reading what must not be missed: what was said while nobody listened is fetched from its senders.

Senders keep what they have said for a while (services/runtime/retention.py). Whoever puts it on disk
reads through `CatchingUp`: a gap before a publication is asked for before that goes on, so that
the order stays; and from time to time everyone is asked what was said last, so that a gap after which
nothing comes is found as well.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from dataclasses import dataclass, field

from schemas.queries import RETAINED
from schemas.retention import RetainedAnswer, RetainedQuestion
from schemas.topic import Place, TopicError
from services.runtime.continuity import Continuity, Sender
from services.runtime.node import Node, Sample
from services.runtime.question import NoAnswerError, RefusedError

ANSWER_S = 2.0
"""A sender that lives answers within this; one that does not has lost what it kept, or is stuck."""
AGAIN_S = (0.2, 0.5)
"""Pauses before a sender without answer is asked again: it may just be starting, or its router be away."""
SURVEYS_S = (0.0, 3.0, 30.0)
"""Pauses before everyone is asked: at once, again for whoever was just starting, and from then on."""


@dataclass(slots=True)
class CatchingUp:
    """One reader. `take` gets every sample in its turn; `room` returns when more of them may come at once."""

    node: Node
    continuity: Continuity
    wants: Callable[[str], bool]
    """Whether a key is read at all."""
    take: Callable[[Sample], None]
    room: Callable[[], Awaitable[None]]
    _asked: dict[Sender, asyncio.Task[None]] = field(default_factory=dict)
    _told: int = 0

    async def run(self, readers: Sequence[AsyncIterator[Sample]]) -> None:
        """Everything that is heard or was missed, until the readers end."""
        async with asyncio.TaskGroup() as tasks:
            surveying = tasks.create_task(self._survey(tasks), name="survey")
            async with asyncio.TaskGroup() as reading:
                for samples in readers:
                    reading.create_task(self._read(samples, tasks))
            for task in (surveying, *self._asked.values()):
                task.cancel()
        for sender in self.continuity.open():
            self._pass_on(self.continuity.give_up_all(sender))

    async def _read(self, samples: AsyncIterator[Sample], tasks: asyncio.TaskGroup) -> None:
        continuity, take = self.continuity, self.take
        async for sample in samples:
            for one in continuity.offer(sample):
                take(one)
            if continuity.waiting:
                self._mend(tasks)

    def _mend(self, tasks: asyncio.TaskGroup) -> None:
        """Ask for what is missing, each sender once at a time."""
        for sender in self.continuity.open():
            if sender not in self._asked:
                self._asked[sender] = tasks.create_task(self._fetch(sender))

    async def _fetch(self, sender: Sender) -> None:
        """Everything that is missing of a sender, or as much as there still is."""
        try:
            while wanted := self.continuity.gaps(sender):
                await self.room()
                question = RetainedQuestion(t_ns=self.node.clock.now_ns(), boot_id=sender[1], wanted=wanted)
                answer = await self._ask(sender[0], question)
                for pause_s in AGAIN_S:
                    if answer is None:
                        await asyncio.sleep(pause_s)
                        answer = await self._ask(sender[0], question)
                self._take_in(sender, question, answer)
        finally:
            del self._asked[sender]

    def _take_in(self, sender: Sender, question: RetainedQuestion, answer: RetainedAnswer | None) -> None:
        if answer is None or answer.boot_id != sender[1]:
            self._pass_on(self.continuity.give_up_all(sender))
        else:
            self._take_records(sender, question, answer)
        if (missed := self.continuity.missed - self._told) > 0:
            self._told += missed
            reason = f"{missed} publications of {sender[0]} were missed, and it keeps them no more"
            self.node.health.count("missed", missed)
            self.node.health.trouble("missed", reason, self.node.clock.monotonic_s())

    def _take_records(self, sender: Sender, question: RetainedQuestion, answer: RetainedAnswer) -> None:
        for key, (first, last) in question.wanted.items():
            kept = answer.kept.get(key)
            oldest = last + 1 if kept is None else min(last + 1, max(first, kept[0]))
            self._pass_on(self.continuity.give_up(sender, key, oldest - 1))
        now_ns = self.node.clock.now_ns()
        for record in answer.records:
            self._pass_on(self.continuity.offer(Sample(record.key, record.payload, record.attachment, now_ns)))
        self.node.health.count("fetched", len(answer.records))
        if not answer.more or not answer.records:
            for key, (_, last) in question.wanted.items():
                self._pass_on(self.continuity.give_up(sender, key, last))

    def _pass_on(self, samples: Sequence[Sample]) -> None:
        for sample in samples:
            self.take(sample)

    async def _ask(self, source: str, question: RetainedQuestion) -> RetainedAnswer | None:
        """Answer of a service; None when there is none."""
        line, _, rest = source.partition("/")
        kind, _, rest = rest.partition("/")
        name, _, instance = rest.partition("/")
        try:
            place = Place(line, kind, name)  # type: ignore[arg-type]  # it refuses other kinds itself
            return await self.node.ask(RETAINED, place, question, timeout_s=ANSWER_S, service=instance)
        except (TopicError, NoAnswerError, RefusedError):
            return None

    async def _survey(self, tasks: asyncio.TaskGroup) -> None:
        """Ask everyone who lives what they have said, for ever."""
        own = f"{self.node.place}/{self.node.instance}"
        pauses = iter(SURVEYS_S)
        while True:
            await asyncio.sleep(next(pauses, SURVEYS_S[-1]))
            for source in sorted(await self.node.services_alive(self.node.place.line) - {own}):
                answer = await self._ask(source, RetainedQuestion(t_ns=self.node.clock.now_ns()))
                if answer is None:
                    continue
                for key in filter(self.wants, answer.kept):
                    self.continuity.expect((source, answer.boot_id), key, answer.kept[key][1])
            self._mend(tasks)
