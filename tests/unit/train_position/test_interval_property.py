"""Whatever true sources say, in whatever order, the published interval holds the truth."""

from __future__ import annotations

from typing import Any, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.message import Message
from schemas.position import TrainChange
from services.train_position.makeup import changed
from services.train_position.settings import Config
from tests.unit.train_position.made_up import Run, run_with

SHARES = st.floats(-1.0, 1.0)
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("run"), st.integers(1, 40), st.floats(-1.0, 1.0)),
        st.tuples(st.just("gnss"), st.floats(1.0, 60.0), SHARES),
        st.tuples(st.just("landmark"), st.floats(2.0, 20.0), SHARES),
        st.tuples(st.just("balise"), st.just(0.0), SHARES),
        st.tuples(st.just("slip"), st.floats(0.0, 20.0), SHARES),
        st.tuples(st.just("provisional"), st.floats(0.0, 20.0), SHARES),
        st.tuples(st.just("cab"), st.just(0.0), st.just(0.0)),
        st.tuples(st.just("coupled"), st.floats(1.0, 60.0), st.one_of(st.none(), st.floats(0.0, 1.0))),
        st.tuples(st.just("uncoupled"), st.floats(1.0, 20.0), st.one_of(st.none(), st.floats(0.0, 1.0))),
        st.tuples(st.just("turned"), st.floats(0.0, 0.04), SHARES),
        st.tuples(st.just("origin"), st.integers(1, 50), st.just(0.0)),
        st.tuples(st.just("silent"), st.integers(1, 50), st.floats(-1.0, 1.0)),
    ),
    min_size=3,
    max_size=25,
)
MOST_MPS = 40.0


class Driver:
    """Carries out steps; measurements arrive after a delay, repeated or overtaken."""

    def __init__(self, run: Run, delays: list[int]) -> None:
        self.run = run
        self._delays = delays
        self._late: list[tuple[int, int, Message]] = []
        self._count = 0
        self._landmarks = 0

    def measured(self, message: Message) -> None:
        delay = self._delays[self._count % len(self._delays)]
        self._count += 1
        self._late.append((self.run.t_ns + delay * 100_000_000, self._count, message))
        if delay % 5 == 0:
            self._late.append((self.run.t_ns + 2 * delay * 100_000_000, -self._count, message))

    def arrive(self) -> None:
        due = sorted(one for one in self._late if one[0] <= self.run.t_ns)
        self._late = [one for one in self._late if one[0] > self.run.t_ns]
        for _, _, message in due:
            self.run.hear(message)

    def drive(self, count: int, acceleration: float, *, silent: bool) -> None:
        run = self.run
        for _ in range(count):
            target_mps = min(max(run.speed_mps + acceleration * 0.1, -MOST_MPS), MOST_MPS)
            run.go(0.1, (target_mps - run.speed_mps) / 0.1, silent=silent)
            self.arrive()
            said = run.keeper.on_time(run.t_ns) if silent and run.heard else []
            run.heard += said
            if said or not silent:
                run.require_true()

    def provisional(self, size: float, share: float) -> None:
        """What is provisional for now becomes an excess for good later."""
        run = self.run
        run.distance_m += share * size
        run.way_m += abs(share * size)
        run.provisional_m = size
        self.drive(2, 0.0, silent=False)
        self.measured(run.front_end(-share, 1.0))
        self.drive(2, 0.0, silent=False)
        run.distance_m -= share * size
        run.way_m += abs(share * size)
        run.provisional_m = 0.0
        run.excess_m += 2.0 * abs(share * size)

    def step(self, kind: str, size: Any, share: Any) -> None:  # noqa: ANN401 - drawn by hypothesis
        run = self.run
        match kind:
            case "run" | "silent":
                self.drive(size, share, silent=kind == "silent")
                return
            case "gnss":
                self.measured(run.front_end(share * size, size))
            case "landmark":
                self._landmarks += 1
                self.measured(run.landmark(f"C{self._landmarks}", share * size, size))
            case "balise":
                self.measured(run.balise(share))
            case "slip":
                run.slip(share * size, size)
            case "provisional":
                self.provisional(size, share)
            case "turned":
                # Heard before the train moves again.
                run.hear(TrainChange(t_ns=run.t_ns, kind="wheel_turned"))
                run.wheel_error = share * size
            case "origin":
                self._late.clear()
                run.go(size * 0.02, 0.0, silent=True)
                run.origin += "'"
                run.distance_m = run.way_m = run.excess_m = 0.0
            case _:
                self.change(kind, size, share)
        self.step("run", 1, 0.0)

    def change(self, kind: str, size: float, share: float | None) -> None:
        run = self.run
        self.step("run", 1, 0.0)
        length_m, cab = run.makeup.length_m, run.makeup.cab
        message = TrainChange(t_ns=run.t_ns, kind="cab", cab="B" if cab == "A" else "A")
        if kind != "cab":
            change_m = size if kind == "coupled" else -min(size, length_m - run.makeup.ahead_m - 5.0, 30.0)
            if length_m + change_m < 25.0 or length_m + change_m > 900.0 or change_m == 0.0:
                return
            known = TrainChange(
                t_ns=run.t_ns,
                kind="coupled" if kind == "coupled" else "uncoupled",
                length_m=length_m + change_m,
                front_shift_m=change_m * (0.0 if share is None else share),
            )
            message = TrainChange(
                t_ns=run.t_ns,
                kind=known.kind,
                length_m=known.length_m,
                front_shift_m=None if share is None else known.front_shift_m,
            )
            run.makeup = changed(run.makeup, known)[0]
        elif run.makeup.forward == "cab":
            run.axis_m = run.front_m - run.sense * length_m
            run.sense, run.speed_mps = -run.sense, -run.speed_mps
            run.makeup = changed(run.makeup, message)[0]
        else:
            run.makeup = changed(run.makeup, message)[0]
        run.hear(message)


@pytest.mark.parametrize(("sense", "forward"), [(1, "vehicle"), (-1, "vehicle"), (1, "cab"), (-1, "cab")])
@settings(max_examples=80, deadline=None)
@given(steps=STEPS, delays=st.lists(st.integers(0, 30), min_size=1, max_size=6), wheel=st.floats(-0.02, 0.02))
def test_true_sources_bound_the_truth(
    sense: int, forward: Literal["cab", "vehicle"], steps: list[tuple[str, Any, Any]], delays: list[int], wheel: float
) -> None:
    config = Config(clock_bound_s=0.0, holdover=0.0, line_accuracy_m=0.0, scale_wander_share=0.0, forward=forward)
    run = run_with(config, sense=sense, axis_m=12_000.0, wheel_error=wheel)
    run.makeup = run.makeup._replace(forward=forward)
    driver = Driver(run, delays)
    driver.step("run", 5, 1.0)
    run.hear(run.front_end(0.0, 20.0))
    for kind, size, share in steps:
        driver.step(kind, size, share)
    for _ in range(30):
        driver.step("run", 3, 0.2)
    run.require_true()


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.tuples(st.integers(1, 30), st.floats(-1.0, 1.0), st.floats(0.0, 5.0)), max_size=12),
    wheel=st.floats(-0.02, 0.02),
)
def test_the_interval_never_shrinks_without_a_reference(steps: list[tuple[int, float, float]], wheel: float) -> None:
    run = run_with(axis_m=12_000.0, wheel_error=wheel)
    run.go(1.0, 1.0)
    run.hear(run.front_end(0.0, 20.0))
    run.go(0.1)
    width_m = 0.0
    for count, acceleration, slip_m in steps:
        if slip_m > 4.0:
            run.slip(slip_m / 2.0, slip_m)
        for _ in range(count):
            run.go(0.1, acceleration)
            least_m, greatest_m = run.margin_m()
            # 1e-9 m: rounding of differences of sums.
            assert greatest_m - least_m >= width_m - 1e-9
            width_m = greatest_m - least_m
