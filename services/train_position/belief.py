"""Between which places the front end is certain to be: intervals intersected, contradictions kept apart.

Set-membership estimation: every claim that holds is an interval that contains the truth, so their
intersection contains it too. References (landmarks, balises) err independently and are intersected with
one another. Satellites are one source whose errors last: of their claims the narrowest one counts, for
the intersection of thousands would promise more than each of them does.

Claims without a common place cannot all be true. Then both stand as alternatives, and the union of them,
with everything between, is what is certain; nothing is averaged. A further claim ends that when it is
evidence of its own: a reference that stands behind neither, or satellites long after and far away from
where they began to be part of the quarrel.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final, Literal, NamedTuple

from services.train_position.claims import STREAM, Claim, Interval, offsets_of, places_of
from services.train_position.instants import Instant

MOST_ALTERNATIVES: Final = 4
"""Beyond them all become one wide interval, which nothing narrows but a reference."""
NAMES: Final = 4
"""Sources that are named behind an alternative."""

Outcome = Literal["taken", "first", "contradiction", "resolved", "repeated"]


class Rules(NamedTuple):
    """When claims contradict each other, and when a source is evidence of its own."""

    scant_share: float
    independent_s: float
    independent_m: float


@dataclass(frozen=True, slots=True)
class Alternative:
    """Places that some sources agree on, as offsets (services.train_position.claims)."""

    references: Interval | None
    stream: Interval | None
    names: tuple[str, ...]

    @property
    def offsets(self) -> Interval:
        """What all of its sources allow."""
        if self.references is None or self.stream is None:
            return self.stream or self.references or Interval(0.0, 0.0)
        return self.references.overlap(self.stream)

    def with_claim(self, offsets: Interval, claim: Claim) -> Alternative:
        """The same, narrowed by a claim that agrees with it."""
        names = (*(name for name in self.names if name != claim.name), claim.name)[-NAMES:]
        if claim.source != STREAM:
            narrowed = offsets if self.references is None else self.references.overlap(offsets)
            return replace(self, references=narrowed, names=names)
        if self.stream is None or offsets.width_m < self.stream.width_m:
            return replace(self, stream=offsets, names=names)
        return replace(self, names=names)


class Verdict(NamedTuple):
    """How a claim was taken."""

    outcome: Outcome
    text: str = ""


@dataclass(slots=True)
class Belief:
    """What is believed of the front end's place."""

    rules: Rules
    alternatives: list[Alternative] = field(default_factory=list)
    since_ns: int = 0
    """When the contradiction began,"""
    since_way_m: float = 0.0
    """and at which way of the odometry."""
    unsettled: bool = False
    """Too many alternatives have become one; a reference must settle it."""

    @property
    def contradicted(self) -> bool:
        """True while sources contradict each other."""
        return len(self.alternatives) > 1 or self.unsettled

    def offsets(self) -> Interval | None:
        """Union of all alternatives, with everything between them."""
        if not self.alternatives:
            return None
        whole = self.alternatives[0].offsets
        for one in self.alternatives[1:]:
            whole = whole.hull(one.offsets)
        return whole

    def places(self, now: Instant) -> Interval | None:
        """Where the front end may be at an instant."""
        offsets = self.offsets()
        return None if offsets is None else places_of(offsets, now)

    def forget(self) -> None:
        """Know nothing any more."""
        self.alternatives.clear()
        self.unsettled = False

    def take(self, claim: Claim, then: Instant, now: Instant) -> Verdict:
        """Weigh a claim that was true at `then`."""
        offsets = offsets_of(claim.axis_m, claim.bound_m, then)
        if not self.alternatives:
            self.alternatives.append(_founded(offsets, claim))
            return Verdict("first", f"first place by {claim.words}")
        agree = [one for one in self.alternatives if self._agrees(one, offsets, now)]
        if not agree:
            return self._contradict(offsets, claim, then, now)
        if self.contradicted and self._independent(claim, agree, then):
            return self._settle(agree, offsets, claim, now)
        kept = [one.with_claim(offsets, claim) if one in agree else one for one in self.alternatives]
        self.alternatives = kept
        return Verdict("taken")

    def _agrees(self, alternative: Alternative, offsets: Interval, now: Instant) -> bool:
        held, claimed = places_of(alternative.offsets, now), places_of(offsets, now)
        return held.overlap(claimed).width_m >= self.rules.scant_share * min(held.width_m, claimed.width_m)

    def _contradict(self, offsets: Interval, claim: Claim, then: Instant, now: Instant) -> Verdict:
        held = places_of(self.alternatives[0].offsets, now)
        names = ", ".join(self.alternatives[0].names)
        text = f"{claim.words}; {names} and the odometry say {held.least_m:.1f} to {held.greatest_m:.1f} m"
        own = [i for i, one in enumerate(self.alternatives) if i > 0 and one.names == (claim.name,)]
        founded = _founded(offsets, claim)
        if own:
            # Its earlier word and this one cannot both hold: what it said spans both.
            earlier = self.alternatives[own[0]]
            both = earlier.offsets.hull(offsets)
            is_stream = claim.source == STREAM
            spans = replace(earlier, stream=both) if is_stream else replace(earlier, references=both)
            self.alternatives[own[0]] = spans
            return Verdict("repeated", text)
        if not self.contradicted:
            self.since_ns, self.since_way_m = then.t_ns, then.way_m
        self.alternatives.append(founded)
        if len(self.alternatives) > MOST_ALTERNATIVES:
            named = tuple(dict.fromkeys(name for one in self.alternatives for name in one.names))
            self.alternatives = [Alternative(self.offsets(), None, named)]
            self.unsettled = True
        return Verdict("contradiction", text)

    def _independent(self, claim: Claim, agree: list[Alternative], then: Instant) -> bool:
        """Whether a claim is further evidence for the alternatives that it agrees with."""
        if all(claim.name not in one.names for one in self.alternatives):
            return True
        if claim.source != STREAM or any(one.names == (claim.name,) for one in agree):
            return False
        return (
            then.t_ns - self.since_ns >= self.rules.independent_s * 1e9
            and then.way_m - self.since_way_m >= self.rules.independent_m
        )

    def _settle(self, agree: list[Alternative], offsets: Interval, claim: Claim, now: Instant) -> Verdict:
        """Drop what further evidence speaks against; what is left is one when its parts agree with one another."""
        refuted = sorted({name for one in self.alternatives if one not in agree for name in one.names})
        backers = sorted({name for one in agree for name in one.names})
        narrowed = [one.with_claim(offsets, claim) for one in agree]
        whole = narrowed[0]
        if len(narrowed) > 1 and all(self._agrees(one, narrowed[0].offsets, now) for one in narrowed[1:]):
            spanned = narrowed[0].offsets
            for one in narrowed[1:]:
                spanned = spanned.hull(one.offsets)
            whole, narrowed = Alternative(spanned, None, narrowed[0].names), narrowed[:1]
        self.alternatives = [whole] if len(narrowed) == 1 else narrowed
        if len(self.alternatives) > 1:
            return Verdict("taken")
        self.unsettled = False
        against = f", against {', '.join(refuted)}" if refuted else ""
        return Verdict("resolved", f"{claim.words} agrees with {', '.join(backers)}{against}")


def _founded(offsets: Interval, claim: Claim) -> Alternative:
    """An alternative of one claim."""
    if claim.source == STREAM:
        return Alternative(None, offsets, (claim.name,))
    return Alternative(offsets, None, (claim.name,))
