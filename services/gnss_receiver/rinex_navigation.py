"""Broadcast orbits, clocks and ionosphere from the text of RINEX navigation files."""

from __future__ import annotations

from collections.abc import Iterable

from schemas.gnss import Ephemeris, Ionosphere
from services.gnss_receiver.ephemeris_record import ephemeris_of, is_fnav
from services.gnss_receiver.observations import FileIssue, Navigation
from services.gnss_receiver.rinex_error import IssueLog
from services.gnss_receiver.rinex_header import label_of
from services.gnss_receiver.rinex_navigation_records import figure, read_records

_NOT_USED = frozenset("SI")
"""SBAS orbits are too coarse for positioning, NavIC is not solved."""
_MODELS = ("GPS", "QZS", "BDS")
"""In order of preference. QZSS: the model of GPS, fitted to Japan; BeiDou: nearly the same model, fitted to China."""
_COEFFICIENTS = 4

Four = tuple[float, float, float, float]


def parse_navigation(files: Iterable[tuple[str, bytes]]) -> Navigation:
    """Everything usable in navigation files, given as path and bytes; the path is only named in issues.

    An ephemeris that stands there twice (satellite, reference time, issue of data) is given once, and
    as unhealthy if one of them is. Of a Galileo satellite that has I/NAV ephemerides, the F/NAV ones
    are left out: their group delay is meant for E5a. Raises RinexError for what is not RINEX navigation.
    """
    found: dict[tuple[str, int, float, int, bool], Ephemeris] = {}
    models: dict[str, Four] = {}
    issues: list[FileIssue] = []
    for path, content in files:
        log = IssueLog(path)
        text = read_records(content.removeprefix(b"\xef\xbb\xbf").decode("ascii", errors="replace").splitlines(), log)
        for key, model in _ionosphere_records(text.header, log).items():
            models.setdefault(key, model)
        for record in text.records:
            if record.system in _NOT_USED:
                continue
            try:
                ephemeris = ephemeris_of(record)
            except ValueError as error:
                log.add(record.line, f"the record of {record.system}{record.number:02d} is left out: {error}")
                continue
            name = (ephemeris.satellite, ephemeris.gps_week, ephemeris.toe_s, ephemeris.issue, is_fnav(record))
            if name not in found or (found[name].healthy and not ephemeris.healthy):
                found[name] = ephemeris
        issues += log.issues()
    with_inav = {satellite for satellite, _, _, _, fnav in found if not fnav}
    ephemerides = tuple(
        ephemeris for (satellite, *_, fnav), ephemeris in found.items() if not (fnav and satellite in with_inav)
    )
    return Navigation(ephemerides, _ionosphere(models), tuple(issues))


def _ionosphere_records(header: list[tuple[int, str]], log: IssueLog) -> dict[str, Four]:
    """Klobuchar coefficients of a header by model and A or B ('GPSA'); those that are all zero are none."""
    found: dict[str, Four] = {}
    for line, text in header:
        match label_of(text):
            case "ION ALPHA":
                name, first = "GPSA", 2
            case "ION BETA":
                name, first = "GPSB", 2
            case "IONOSPHERIC CORR" if text[:3] in _MODELS and text[3:4] in {"A", "B"}:
                name, first = text[:4], 5
            case _:
                continue
        try:
            a, b, c, d = (figure(text[at : at + 12]) or 0.0 for at in range(first, first + 12 * _COEFFICIENTS, 12))
        except ValueError as error:
            log.add(line, f"the ionosphere is left out: {error}")
            continue
        if any((a, b, c, d)):
            found.setdefault(name, (a, b, c, d))
    return found


def _ionosphere(models: dict[str, Four]) -> Ionosphere | None:
    for model in _MODELS:
        alpha, beta = models.get(f"{model}A"), models.get(f"{model}B")
        if alpha is not None and beta is not None:
            return Ionosphere(t_ns=0, alpha=alpha, beta=beta)
    return None
