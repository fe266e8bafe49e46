"""Corrects every receiver of a train: epochs in, a fix and a verdict on every satellite out."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from schemas.gnss import Corrections, Ephemeris, Epoch, Fix, Ionosphere
from schemas.topics import (
    GNSS_COMPARISON,
    GNSS_CORRECTION,
    GNSS_EPHEMERIS,
    GNSS_EPOCH,
    GNSS_FIX,
    GNSS_FRONT_END,
    GNSS_IONOSPHERE,
    GNSS_VERDICT,
)
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.front_end import FrontEndFinder
from services.gnss_correction.line_method import Line, warm_up
from services.gnss_correction.pipeline import Correction, silent_epoch
from services.gnss_correction.settings import Config
from services.gnss_correction.thresholds_file import read_thresholds
from services.gnss_correction.verdict_messages import verdicts_of
from services.line.line_file import read_line
from services.runtime.node import Arrival, Node, Service

MOST_DEVICES: Final = 16
"""Receivers of one train; more are a mistake in somebody's keys."""


def _warm_up(config: Config, line: Line | None) -> None:
    """Compile the kernels, or load them from their cache, before the first epoch waits for them."""
    if line is not None:
        warm_up(line)
    Correction(config, line=line).epoch(silent_epoch())


def _note(node: Node, device: str, fix: Fix) -> None:
    """Count, and say in health while a receiver has no fix."""
    node.health.count("epochs")
    node.health.count(f"epochs_{fix.status}")
    if fix.status == "fix":
        node.health.clear(f"no_fix:{device}")
    else:
        node.health.set(f"no_fix:{device}", f"no fix from {device}: {fix.reason}")


async def _answer(node: Node, device: str, correction: Correction, epoch: Epoch, finder: FrontEndFinder) -> None:
    """Publish everything that follows from one epoch."""
    corrected = correction.epoch(epoch)
    primary, *others = correction.methods
    (fix,) = fixes_of(corrected, primary)
    (verdicts,) = verdicts_of(corrected)
    _note(node, device, fix)
    await node.publish(GNSS_FIX, fix, device=device)
    front_end = finder.take(device, fix)
    if front_end is not None:
        await node.publish(GNSS_FRONT_END, front_end)
        if front_end.agreement == "disagree":
            node.health.set("antennas", f"antennas disagree: {front_end.reason}")
        else:
            node.health.clear("antennas")
    for method in others:
        (other,) = fixes_of(corrected, method)
        await node.publish(GNSS_COMPARISON, other, device=device, method=method)
    await node.publish(GNSS_VERDICT, verdicts, device=device)


async def run(node: Node, config: Config) -> None:
    """Answer epochs until asked to stop; every epoch gets a fix or a reason."""
    arrivals = node.arrivals(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE)
    corrected = node.arrivals(GNSS_CORRECTION, anywhere=True)
    line = None
    if config.line_file:
        geometry = await node.in_thread(lambda: read_line(Path(config.line_file)))
        line = Line(geometry, antenna_above_m=config.antenna_above_line_m)
    await node.in_thread(lambda: _warm_up(config, line))
    thresholds = None
    if config.thresholds_file:
        thresholds = await node.in_thread(lambda: read_thresholds(Path(config.thresholds_file)))
    node.ready()
    corrections: dict[str, Correction] = {}
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(_take_corrections(node, config, corrected, corrections), name="corrections")
        finder = FrontEndFinder(config.antennas, config.facing)
        async for arrival in arrivals:
            device = arrival.fields["device"]
            if device not in corrections:
                if len(corrections) == MOST_DEVICES:
                    node.health.refuse(f"more than {MOST_DEVICES} receivers: {device}", node.clock.monotonic_s())
                    continue
                corrections[device] = Correction(config, thresholds=thresholds, line=line)
            match arrival.message:
                case Epoch() as epoch:
                    await _answer(node, device, corrections[device], epoch, finder)
                case Ephemeris() | Ionosphere() as broadcast:
                    corrections[device].add(broadcast)


async def _take_corrections(
    node: Node, config: Config, arrivals: AsyncIterator[Arrival[Corrections]], corrections: dict[str, Correction]
) -> None:
    """Hand what a reference station of the line corrects to every receiver; one that begins later gets the next."""
    async for arrival in arrivals:
        if config.reference and arrival.place.name != config.reference:
            node.health.count("corrections_of_other_stations")
            continue
        node.health.count("corrections")
        for device, correction in corrections.items():
            refusal = correction.correct_by(arrival.message)
            if refusal:
                node.health.refuse(
                    f"correction by {arrival.place.name} for {device}: {refusal}", node.clock.monotonic_s()
                )


SERVICE = Service(
    "gnss_correction",
    Config,
    reads=(GNSS_EPOCH, GNSS_EPHEMERIS, GNSS_IONOSPHERE, GNSS_CORRECTION),
    writes=(GNSS_FIX, GNSS_COMPARISON, GNSS_FRONT_END, GNSS_VERDICT),
    run=run,
    about="positions from GNSS epochs, corrected by a reference station, with a multipath verdict on every satellite",
)
