"""Radio devices on the bus: their reports with time and place, and the weather along the line."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Final

from schemas.radio import RadioMeasurement
from schemas.topics import RADIO_MEASUREMENT, RADIO_READING, TRAIN_POSITION, WEATHER
from services.byte_source.rate_watch import RateWatch
from services.byte_source.source import RetryPauses, SourceError
from services.radio_probe.device_reports import Report, modem_report, reports_of
from services.radio_probe.input_stream import Source, SourceEndedError, modem_line, source_of
from services.radio_probe.joining import Joiner
from services.radio_probe.modem_dialogue import ModemDialogue
from services.radio_probe.reading_check import ReadingCheck
from services.radio_probe.settings import Config, RadioInput, Stamps
from services.runtime.node import Node, Service

FLUSH_S: Final = 0.25
IDLE_S: Final = 0.05
"""Between readings of a source that has nothing; lines have waited for some time by themselves."""
PAUSE_S: Final = 5.0
"""After so long without a byte the last sweep of a scan is taken for complete."""


async def run(node: Node, config: Config) -> None:
    """Publish until stopped."""
    probe = RadioProbe(node, config)
    async with asyncio.TaskGroup() as group:
        group.create_task(probe.follow_positions())
        if config.bus:
            group.create_task(probe.follow_bus())
        for one in config.inputs:
            group.create_task(probe.follow_modem(one) if one.format == "modem" else probe.follow_lines(one))
        group.create_task(probe.flush())
        node.ready()


class RadioProbe:
    """All devices of one place."""

    def __init__(self, node: Node, config: Config) -> None:
        """Subscribe; begin with nothing heard."""
        self._node, self._config = node, config
        self._onboard = node.place.kind == "train"
        self._side = "onboard" if self._onboard else "wayside"
        self._check = ReadingCheck(config.largest_clock_error_s)
        self._joiner = Joiner(config.wait_s, config.largest_gap_s, config.largest_bound_m)
        self._positions = node.arrivals(TRAIN_POSITION, anywhere=not self._onboard)
        self._readings = node.arrivals(RADIO_READING)
        self._joining = asyncio.Lock()

    async def follow_positions(self) -> None:
        """Remember where trains are: the own one, or on the wayside all of them."""
        async for arrival in self._positions:
            self._joiner.position(arrival.place.name, arrival.message)
            await self._publish_ready()

    async def follow_bus(self) -> None:
        """Take what devices report on the bus."""
        async for arrival in self._readings:
            await self._take(arrival.fields["device"], arrival.message, self._config.bus_stamps)

    async def follow_lines(self, settings: RadioInput) -> None:
        """Take what an input sends by itself."""
        node, name = self._node, settings.device
        reports = reports_of(settings, self._side)
        rate = RateWatch(settings.rate_hz, node.clock.monotonic_s())
        heard_s = node.clock.monotonic_s()
        async for chunk in self._chunks(settings, source_of(settings)):
            now_s = node.clock.monotonic_s()
            heard_s = now_s if chunk else heard_s
            found = reports.feed(chunk or b"")
            if chunk is None or now_s - heard_s >= PAUSE_S:
                found += reports.pause()
            for report in found:
                rate.heard(now_s)
                await self._take(name, report, settings.stamps)
            self._tell(f"{name}_rate", rate.fault(node.clock.monotonic_s()))
            self._tell(f"{name}_lines", f"{name}: {reports.reason}" if reports.reason else "")
            node.health.counts.update({f"{name}_{what}": count for what, count in reports.counts.items()})

    async def follow_modem(self, settings: RadioInput) -> None:
        """Ask a modem again and again."""
        node, name = self._node, settings.device
        line, dialogue = modem_line(settings), ModemDialogue(settings.commands, settings.every_s)
        rate = RateWatch(settings.rate_hz, node.clock.monotonic_s())
        connections = 0
        async for chunk in self._chunks(settings, line):
            now_s = node.clock.monotonic_s()
            if node.health.counts[f"{name}_connections"] != connections:
                connections = node.health.counts[f"{name}_connections"]
                dialogue.begin(now_s)
            for signal in dialogue.feed(chunk or b""):
                rate.heard(now_s)
                await self._take(name, modem_report(settings, self._side, signal), settings.stamps)
            command = dialogue.next_command(now_s)
            if command is not None:
                with suppress(SourceError):  # reading says what is wrong, and opens the line anew
                    await node.in_thread(lambda: line.write(command))  # noqa: B023 - awaited before the next turn
            self._tell(f"{name}_rate", rate.fault(now_s))
            unknown = dialogue.given_up
            self._tell(f"{name}_commands", f"{name} does not know {', '.join(unknown)}" if unknown else "")
            node.health.counts.update({f"{name}_{what}": count for what, count in dialogue.counts.items()})

    async def flush(self) -> None:
        """Let go what has waited for long enough."""
        while await self._node.sleep(FLUSH_S):
            await self._publish_ready()

    async def _take(self, device: str, report: Report, stamps: Stamps) -> None:
        node, check = self._node, self._check
        now_ns = node.clock.now_ns()
        if isinstance(report, RadioMeasurement):
            reading = check.reading(device, report, now_ns, stamps)
            if reading is not None:
                train = node.place.name if self._onboard else reading.train
                # Those that wait are looked at with every position and a few times a second, not with every report.
                if self._joiner.take(device, reading, train, node.clock.monotonic_s()):
                    await self._publish_ready()
        else:
            weather = check.weather(device, report, now_ns, stamps)
            if weather is not None:
                await node.publish(WEATHER, weather)
        if any(node.health.counts.get(name, 0) != count for name, count in check.counts.items()):
            node.health.counts.update(check.counts)
            node.health.trouble("reports", check.reason, node.clock.monotonic_s())

    async def _publish_ready(self) -> None:
        node = self._node
        # One at a time, so that what became ready first goes out first.
        async with self._joining:
            for one in self._joiner.ready(node.clock.monotonic_s()):
                await node.publish(RADIO_MEASUREMENT, one.message, device=one.device)
                node.health.count("without_place" if one.reason else "measurements")
                self._tell("place", f"measurements go out without a place: {one.reason}" if one.reason else "")

    def _tell(self, name: str, fault: str) -> None:
        if fault:
            self._node.health.set(name, fault)
        else:
            self._node.health.clear(name)

    async def _chunks(self, settings: RadioInput, source: Source) -> AsyncIterator[bytes | None]:
        """What an input brings, nothing too, until the service is to stop; opened anew. None when it has ended."""
        node, name, pauses = self._node, settings.device, RetryPauses()
        while not node.stopping:
            fault = ""
            try:
                await node.in_thread(source.open)
                node.health.count(f"{name}_connections")
                heard_s = node.clock.monotonic_s()
                while not fault and not node.stopping:
                    chunk = await node.in_thread(source.read)
                    if chunk:
                        pauses.reset()
                        node.health.clear(f"{name}_line")
                        heard_s = node.clock.monotonic_s()
                    yield chunk
                    # A file that stands still is no fault; a line is.
                    silent_s = node.clock.monotonic_s() - heard_s
                    if not settings.file and not settings.standard_input and silent_s >= settings.silence_s:
                        fault = f"nothing came for {silent_s:.1f} s"
                    await node.sleep(0.0 if chunk else IDLE_S)
            except SourceEndedError:
                node.health.set(f"{name}_line", f"{source.name} has ended")
                yield None
                return
            except SourceError as error:
                fault = str(error)
            finally:
                await node.in_thread(source.close)
            if not node.stopping:
                pause_s = pauses.take()
                node.health.set(f"{name}_line", f"{source.name}: {fault}; trying again in {pause_s:.0f} s", "failed")
                await node.sleep(pause_s)


SERVICE = Service(
    "radio_probe",
    Config,
    reads=(RADIO_READING, TRAIN_POSITION),
    writes=(RADIO_MEASUREMENT, WEATHER),
    run=run,
    about="what radios measure, joined to where the train was, from devices of many kinds; the weather along the line",
)
