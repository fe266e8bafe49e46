"""Radio watched on the bus: measurements in, events out, and what is normal learned on the way."""

from __future__ import annotations

import asyncio
import os
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.message import Message
from schemas.radio import RadioAcceptance, RadioEvent, RadioMeasurement, Weather
from schemas.topics import RADIO_ACCEPTANCE, RADIO_EVENT, RADIO_MEASUREMENT, RADIO_SECTION, WEATHER
from services.radio_anomaly.given_model_file import GivenModelFile
from services.radio_anomaly.live_passes import LivePass, LivePasses
from services.radio_anomaly.monitor import Judgement, Monitor
from services.radio_anomaly.passes import Journey, binned, sorted_passes
from services.radio_anomaly.radio_model import Origin, RadioModel, evidence_of, model_of, monitor_of
from services.radio_anomaly.radio_model_file import read_model, write_model
from services.radio_anomaly.raising import Raiser
from services.radio_anomaly.reading import lacks_place, reading_of, refusal_of
from services.radio_anomaly.section_words import section_messages
from services.radio_anomaly.settings import Settings
from services.radio_anomaly.taking_over import is_newer, taken_over, why_not
from services.radio_anomaly.weather_map import Sky, WeatherMap
from services.runtime.clock import LiveClock
from services.runtime.node import Arrival, Node, Service
from services.runtime.state_dir import state_dir


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the radio's watch."""

    model_file: str = ""
    """Model to begin with, as `kirotei radio learn` writes it, packed or not; one that is put there later is taken
    over when it is newer. Without one it learns from what it hears first."""
    state: bool = True
    """Keep the model on disk, with what was learned since; `model_file` counts before it only where it is newer."""
    state_folder: str = ""
    """Where; empty for the host's own folder, which a replay of a recording neither reads nor writes."""
    anywhere: bool = False
    """Listen to every place of the line, not only to its own: on the wayside or in the cloud."""
    mirrored: bool = False
    """Listen to what came over a bridge: in the cloud."""
    settings: Settings = Settings()
    """What decides, where no model brings its own."""
    judge_every: Annotated[int, Meta(ge=1, le=1000)] = 3
    """Sections after which a pass under way is judged again."""
    silent_s: Annotated[float, Meta(ge=5.0, le=86_400.0)] = 300.0
    """After this long without a measurement a pass is over."""
    save_s: Annotated[float, Meta(ge=1.0, le=3600.0)] = 30.0
    """Between two writings of the model at least."""


TICK_S = 5.0


class _Watch:
    """One core for file and bus: it feeds passes to the monitor, and says what comes of them."""

    def __init__(self, node: Node, config: Config, model: RadioModel) -> None:
        self._node, self._config = node, config
        self._watch_by(model)
        self._passes = LivePasses(self._monitor.settings, model.telling)
        self._weather = WeatherMap()
        self.changed = False

    def _watch_by(self, model: RadioModel) -> None:
        self._origin, self._evidence = model.origin, model.evidence
        self._monitor: Monitor = monitor_of(model)
        self._raiser = Raiser(self._monitor, evidence_of(model))

    async def replaced(self, file: GivenModelFile) -> None:
        """Take over the model that stands in the file now, where it is newer; passes under way go on."""
        kept = self.model()

        def work() -> RadioModel | None:
            return _newer(self._node, file, kept)

        found = await self._node.in_thread(work)
        if found is not None:
            self._watch_by(found)
            self.changed = True

    def model(self) -> RadioModel:
        """All that is known now."""
        model = model_of(self._monitor, self._origin, self._evidence)
        return msgspec.structs.replace(model, telling=self._passes.telling())

    async def take(self, arrival: Arrival[Message]) -> None:
        """Answer one message."""
        match arrival.message:
            case RadioMeasurement() as measurement:
                await self._measure(arrival, measurement)
            case Weather() as weather:
                self._weather.take(weather)
            case RadioAcceptance() as word:
                if self._monitor.accept(word):
                    self._node.health.count("revocations" if word.revoked else "acceptances")
                    self.changed = True
            case _:
                pass

    async def _measure(self, arrival: Arrival[Message], measurement: RadioMeasurement) -> None:
        node = self._node
        reading = reading_of(measurement)
        device = arrival.fields["device"]
        source = f"{arrival.place}/{device}/{'line' if reading.direction else 'site'}"
        if self._is_again(arrival, source, reading.t_ns):
            return
        reason = refusal_of(reading)
        if reason is not None:
            node.health.refuse(f"{arrival.key}: {reason}", node.clock.monotonic_s())
            return
        if lacks_place(measurement):
            # Not a site's history either: where a train was that nobody could place, it was somewhere else each time.
            node.health.count("no_place")
            node.health.set(f"no_place {arrival.place.name}", f"{arrival.key}: no place, so nothing is watched there")
            return
        node.health.clear(f"no_place {arrival.place.name}")
        node.health.count("measurements")
        now_s = node.clock.monotonic_s()
        current, over = self._passes.take(source, device, reading, measurement.axis_m, now_s)
        current.note(arrival.boot_id, arrival.sequence, reading.t_ns)
        for one in over:
            await self.finish(one)
        if current.sections_since >= self._config.judge_every:
            current.sections_since = 0
            await self._look(current)

    def _is_again(self, arrival: Arrival[Message], source: str, t_ns: int) -> bool:
        """Whether it is of a pass that the model kept has learned: the bus says it again to a watch that restarts."""
        node = self._node
        match self._monitor.heard.is_again(source, arrival.boot_id, arrival.sequence, t_ns):
            case "again":
                node.health.count("said_again")
                return True
            case "renumbered":
                node.health.count("renumbered")
                words = f"{arrival.key}: numbers that were had, with later times: taken as new"
                node.health.trouble("renumbered", words, node.clock.monotonic_s())
                return False
            case _:
                return False

    async def _look(self, current: LivePass) -> None:
        """Judge a pass so far."""
        journey = await self._journey(current)
        if journey is None:
            return
        sky = self._sky(current, journey.last_ns)

        def judge() -> tuple[list[RadioEvent], Judgement]:
            judgement = self._monitor.judge(journey)
            # A trend is a matter of whole passes.
            steps = msgspec.structs.replace(judgement, trends=())
            return self._raiser.events_of(journey, steps, sky), judgement

        events, judgement = await self._node.in_thread(judge)
        await self._say(current, journey, events, judgement)

    async def finish(self, current: LivePass) -> None:
        """Judge a whole pass, and learn from it."""
        self._monitor.heard.learned(current.source, current.heard)
        self.changed = True
        journey = await self._journey(current)
        if journey is None:
            return
        sky = self._sky(current, journey.last_ns)
        events, judgement = await self._node.in_thread(lambda: self._raiser.take(journey, sky))
        await self._say(current, journey, events, judgement)
        self._node.health.count("passes")
        self._node.health.count("left_out", current.left_out)
        if judgement.learning:
            names = ", ".join(f"{radio} {channel}" for radio, channel in judgement.learning[:5])
            self._node.health.set("learning", f"learning {names}: nothing is raised yet")
        else:
            self._node.health.clear("learning")

    def _sky(self, current: LivePass, t_ns: int) -> Sky:
        """Weather by kilometrage, as the train's own place relates it to the axis."""
        offset_m = current.offset_m

        def sky(place_m: float | None) -> Weather | None:
            return self._weather.at(None if place_m is None or offset_m is None else place_m + offset_m, t_ns)

        return sky

    async def _journey(self, current: LivePass) -> Journey | None:
        """Binned, without readings that cannot be of this pass."""
        settings, readings = self._monitor.settings, tuple(current.readings)

        def work() -> tuple[Journey | None, Counter[str]]:
            passes, left = sorted_passes(readings, settings)
            mine = max(passes, key=len, default=None)
            return (None if mine is None else binned(mine, settings)), left

        journey, left = await self._node.in_thread(work)
        current.left_out = sum(left.values())
        return journey

    async def _say(
        self, current: LivePass, journey: Journey, events: Sequence[RadioEvent], judgement: Judgement
    ) -> None:
        node = self._node
        for event in events:
            # Within a pass an event is told once, and again when it is confirmed or more of it shows another cause.
            said = current.told.get(event.event_id)
            if event.phase != "ended" and said in ((True, event.cause), (event.confirmed, event.cause)):
                continue
            current.told[event.event_id] = (event.confirmed, event.cause)
            self.changed = True
            node.health.count(f"events_{event.kind}")
            await node.publish(RADIO_EVENT, event, device=current.device)
        for section in section_messages(journey, judgement, self._monitor.settings, current.shown):
            at = int(section.section_start_m // self._monitor.settings.section_m)
            current.shown.add((section.radio, section.channel, at))
            await node.publish(RADIO_SECTION, section, device=current.device)

    async def silent(self) -> None:
        """Finish passes of which nothing comes any more."""
        for one in self._passes.silent(self._node.clock.monotonic_s(), self._config.silent_s):
            await self.finish(one)

    async def rest(self) -> None:
        """Finish what is under way."""
        for one in self._passes.rest():
            await self.finish(one)


async def run(node: Node, config: Config) -> None:
    """Judge every pass while it is driven and when it is over; learn at the end of each day."""
    arrivals = node.arrivals(
        RADIO_MEASUREMENT, WEATHER, RADIO_ACCEPTANCE, anywhere=config.anywhere, mirrored=config.mirrored
    )
    path = _state_path(node, config)
    file = GivenModelFile(Path(config.model_file)) if config.model_file else None
    watch = _Watch(node, config, await node.in_thread(lambda: _model(node, config, path, file)))
    node.ready()
    lock = asyncio.Lock()
    async with asyncio.TaskGroup() as tasks:
        ticking = tasks.create_task(_tick(node, config, watch, (path, file), lock), name="silence and state")
        async for arrival in arrivals:
            async with lock:
                await watch.take(arrival)
        ticking.cancel()
    await watch.rest()
    if path is not None:
        await _save(node, watch, path)


async def _tick(
    node: Node, config: Config, watch: _Watch, files: tuple[Path | None, GivenModelFile | None], lock: asyncio.Lock
) -> None:
    saved_s = node.clock.monotonic_s()
    path, file = files
    while await node.sleep(TICK_S):
        async with lock:
            await watch.silent()
            if file is not None and await node.in_thread(file.changed):
                await watch.replaced(file)
            if path is not None and watch.changed and node.clock.monotonic_s() - saved_s >= config.save_s:
                saved_s = node.clock.monotonic_s()
                await _save(node, watch, path)


async def _save(node: Node, watch: _Watch, path: Path) -> None:
    """Keep the model; a full disk does not stop the watch, but is told."""
    model = watch.model()
    try:
        await node.in_thread(lambda: write_model(path, model))
    except OSError as error:
        node.health.set("state", f"cannot keep the radio model: {error}")
    else:
        watch.changed = False
        node.health.clear("state")


def _state_path(node: Node, config: Config) -> Path | None:
    if not config.state or not (config.state_folder or isinstance(node.clock, LiveClock)):
        return None
    place = f"{node.place.line}-{node.place.kind}-{node.place.name}"
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", place)
    folder = state_dir(os.environ, config.state_folder or None) / "radio_anomaly"
    return folder / f"{safe}-{zlib.crc32(place.encode()):08x}.json"


def _model(node: Node, config: Config, path: Path | None, file: GivenModelFile | None) -> RadioModel:
    """The model kept, or what the given one makes of it where that is newer; else the one given, else an empty one."""
    kept: RadioModel | None = None
    if path is not None and path.exists():
        try:
            kept = read_model(path)
        except (ValueError, OSError) as error:
            node.health.refuse(f"the radio model kept cannot be used: {error}", node.clock.monotonic_s())
    there = file is not None and file.changed()
    if file is not None and not there:
        node.health.set("model_file", f"{file.path}: no radio model there yet")
    if kept is not None:
        return (_newer(node, file, kept) if file is not None and there else None) or kept
    if file is not None and there:
        model = file.read()
        if model.method != "line":
            msg = f"{file.path}: the service works by the method `line`, not `{model.method}`"
            raise ValueError(msg)
        return model
    return RadioModel(settings=config.settings, origin=Origin(source="radio_anomaly"))


def _newer(node: Node, file: GivenModelFile, kept: RadioModel) -> RadioModel | None:
    """What the model in the file makes of the one kept; None, and why in health, where it is of no use or no newer."""
    node.health.clear("model_file")
    try:
        given = file.read()
        reason = why_not(given, kept)
    except (ValueError, OSError) as error:
        reason = str(error)
    if reason is not None:
        words = f"the radio model given is not taken over: {reason} ({file.path})"
        node.health.refuse(words, node.clock.monotonic_s())
        return None
    if not is_newer(given, kept):
        return None
    node.health.count("models_taken_over")
    words = f"the radio model learned until {given.origin.last_utc} from {given.origin.passes} passes is taken over"
    node.health.trouble("model", words, node.clock.monotonic_s())
    return taken_over(given, kept)


SERVICE = Service(
    "radio_anomaly",
    Config,
    reads=(RADIO_MEASUREMENT, WEATHER, RADIO_ACCEPTANCE),
    writes=(RADIO_EVENT, RADIO_SECTION),
    run=run,
    about="learns the radio along the line, and tells what leaves its normal, is missing or will fail",
)
