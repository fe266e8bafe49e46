"""Several faults on one pass: the clearest is found, its sections are laid aside, and the rest is judged anew.

A strong fault pulls the estimate of what the whole pass shares, so that sections which are as they were look changed
the other way. With the fault's sections gone from the sums they do not.
"""

from __future__ import annotations

from typing import Final

import msgspec

from services.radio_anomaly.settings import Settings
from services.radio_anomaly.steps import Finding, Stream, WindowMemory, find_steps, window_sums
from services.radio_anomaly.window_test import Correlation, PassTest, Residuals, WindowSum, pass_tests, without

MOST_FINDINGS: Final = 8
"""On one pass of one radio and channel. A pass with more of them has a trouble that no list of places tells."""


class Peeled(msgspec.Struct, frozen=True):
    """What one quantity of one radio and channel shows on a pass."""

    findings: tuple[Finding, ...]
    sums: list[WindowSum]
    """Of every window: over a finding as with it, elsewhere as without."""
    rest: tuple[PassTest, ...]
    """Tests of the sections that are in no finding; those of all where none is left."""


def peel(
    stream: Stream,
    residuals: Residuals,
    tests: tuple[PassTest, ...],
    memory: WindowMemory,
    settings: Settings,
    correlation: Correlation,
    *,
    site: bool,
) -> Peeled:
    """Findings one after another, the clearest first."""
    sums = {(one.start, one.length): one for one in window_sums(tests, settings)}
    findings: list[Finding] = []
    rest, rest_tests, rest_sums = residuals, tests, list(sums.values())
    while len(findings) < MOST_FINDINGS:
        found = find_steps(stream, rest_sums, rest, memory, settings)
        if not found:
            break
        findings.append(found[0])
        rest = without(rest, found[0].start, found[0].length)
        if not len(rest.sections):
            break
        rest_tests = pass_tests(rest, correlation, site=site)
        rest_sums = window_sums(rest_tests, settings)
    for one in rest_sums if findings and len(rest.sections) else ():
        if not one.length or not any(finding.overlaps(one.start, one.length) for finding in findings):
            sums[(one.start, one.length)] = one
    return Peeled(tuple(findings), list(sums.values()), rest_tests)
