"""Recognises curves of the line by their curvature: odometry and position in, references and branch evidence out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.motion import Odometry
from schemas.position import BranchEvidence, LandmarkMatch, TrainPosition
from schemas.topics import BRANCH_EVIDENCE, LANDMARK_MATCH, ODOMETRY, TRAIN_POSITION
from services.landmark_matching.landmarks_file import read_landmarks
from services.landmark_matching.line_landmarks import DatabaseError, LineLandmarks, line_landmarks
from services.landmark_matching.live_matching import LiveMatching
from services.landmark_matching.profile_walk import warm_up
from services.landmark_matching.settings import MatchSettings
from services.line.line_file import load_line
from services.runtime.node import Node, Service

Place = Annotated[float, Meta(ge=-500.0, le=500.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the matching."""

    line_file: str = "demo"
    """Line file, or the name of a line that comes with Kirotei."""
    landmarks_file: str = ""
    """Surveyed landmarks (`kirotei landmarks survey`); empty: those of the line file, or of its geometry."""
    sensor_behind_front_m: Place = 0.0
    """How far the inertial sensor is behind the front end, while the end that its x axis points to leads."""
    sensor_behind_other_end_m: Place = 0.0
    """The same while the other end leads."""
    matching: MatchSettings = MatchSettings()


def _load(config: Config) -> LineLandmarks:
    database = read_landmarks(Path(config.landmarks_file)) if config.landmarks_file else None
    known = line_landmarks(load_line(Path(config.line_file)).line, database)
    warm_up(known.routes)
    return known


async def run(node: Node, config: Config) -> None:
    """Match until asked to stop. Raises what is wrong with the files; landmarks of another line show in health."""
    arrivals = node.messages(ODOMETRY, TRAIN_POSITION)
    live = None
    try:
        known = await node.in_thread(lambda: _load(config))
        live = LiveMatching(known, config.matching, config.sensor_behind_front_m, config.sensor_behind_other_end_m)
    except DatabaseError as error:
        node.health.set("line_version", f"landmarks refused: {error}")
    node.ready()
    told: set[str] = set()
    async for message in arrivals:
        if live is None:
            continue
        match message:
            case Odometry():
                for found in live.take_odometry(message):
                    await _publish(node, found)
                    _say_moved(node, live, told)
            case TrainPosition():
                live.take_position(message)
                _say_version(node, live)


def _say_version(node: Node, live: LiveMatching) -> None:
    if live.wrong_version:
        node.health.set("line_version", f"landmarks refused: {live.wrong_version}")
    else:
        node.health.clear("line_version")


def _say_moved(node: Node, live: LiveMatching, told: set[str]) -> None:
    """Say which landmarks may have moved, and take back what later passages did not confirm."""
    suspects = {f"moved:{one.landmark}": one.text for one in live.moved}
    for name in told - set(suspects):
        node.health.clear(name)
    for name, text in suspects.items():
        node.health.set(name, text)
    told.clear()
    told.update(suspects)


async def _publish(node: Node, found: LandmarkMatch | BranchEvidence) -> None:
    match found:
        case LandmarkMatch():
            node.health.count("accepted" if found.accepted else "refused")
            await node.publish(LANDMARK_MATCH, found)
        case BranchEvidence():
            node.health.count("branch_evidence")
            await node.publish(BRANCH_EVIDENCE, found)


SERVICE = Service(
    "landmark_matching",
    Config,
    reads=(ODOMETRY, TRAIN_POSITION),
    writes=(LANDMARK_MATCH, BRANCH_EVIDENCE),
    run=run,
    about="curves recognised by their curvature as virtual balises, and the branch that the curvature speaks for",
)
