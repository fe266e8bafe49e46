"""The radio's watch on the bus in virtual time: passes in, events and sections out, state kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest

from schemas.codec import decode, encode
from schemas.message import Message
from schemas.radio import RadioAcceptance, RadioEvent, RadioMeasurement, RadioSection, Weather
from schemas.topic import Place, Topic
from schemas.topics import RADIO_ACCEPTANCE, RADIO_EVENT, RADIO_MEASUREMENT, RADIO_SECTION, WEATHER, topic_of
from services.radio_anomaly.file_analysis import learn
from services.radio_anomaly.radio_model_file import read_model, write_model
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.service import SERVICE, TICK_S, Config
from services.radio_anomaly.settings import Settings
from services.recorder.offline_replay import replay_through
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample
from tests.unit.radio_anomaly.made_up import DAY_NS, one_pass

TRAIN = Place("made-up", "train", "T1")
STRETCH = (15, 25)


def message_of(one: Reading) -> RadioMeasurement:
    return RadioMeasurement(
        t_ns=one.t_ns,
        radio=one.radio,
        channel=one.channel,
        channel_power_dbm=one.power_dbm,
        chainage_m=one.chainage_m,
        axis_m=None if one.chainage_m is None else one.chainage_m + 10_000.0,
        direction=one.direction,
        pass_id=one.pass_id,
    )


def sample(topic: Topic[Message], message: Message, number: int, place: Place = TRAIN, **fields: str) -> Sample:
    attachment = encode_attachment(Attachment("tape", "boot", number, message.t_ns))
    return Sample(topic.at(place, **fields), encode(message), attachment, message.t_ns)


def tape(passes: Sequence[Sequence[Reading]], *others: tuple[Topic[Message], Message]) -> list[Sample]:
    found = [
        sample(RADIO_MEASUREMENT, message_of(one), number, device="cab")
        for number, one in enumerate(one for each in passes for one in each)
    ]
    found += [sample(topic, message, 10**6 + number) for number, (topic, message) in enumerate(others)]
    return sorted(found, key=lambda one: one.received_ns)


def said(samples: Sequence[Sample], config: Config) -> tuple[list[RadioEvent], list[RadioSection]]:
    events: list[RadioEvent] = []
    sections: list[RadioSection] = []
    for one in replay_through(samples, [SERVICE], {"radio_anomaly": config}):
        address = topic_of(one.key)
        if address is not None and address.topic is RADIO_EVENT:
            assert address.fields["device"] == "cab"
            events.append(decode(RadioEvent, one.payload))
        elif address is not None and address.topic is RADIO_SECTION:
            sections.append(decode(RadioSection, one.payload))
    return events, sections


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("radio") / "model.json"
    write_model(path, learn([one for n in range(24) for one in one_pass(n)], Settings(), "line", "made up", Counter()))
    return path


def faulty(numbers: Sequence[int]) -> list[list[Reading]]:
    return [one_pass(number, change_db=-12.0, stretch=STRETCH) for number in numbers]


def test_a_fault_is_told_while_the_train_is_still_on_the_line(model_file: Path) -> None:
    passes = [one_pass(24), *faulty([25, 26])]
    events, sections = said(tape(passes), Config(model_file=str(model_file)))
    sure = [one for one in events if one.confirmed]
    assert {one.kind for one in sure} == {"below"}
    assert {one.event_id for one in sure} == {sure[0].event_id}
    assert sure[0].pass_id == "P025"
    assert sure[0].t_ns < passes[1][-1].t_ns, "not only at the end of the pass"
    assert sure[0].false_alarm_rate is not None
    per_pass = Counter(one.pass_id for one in sections)
    assert per_pass == {"P024": 40, "P025": 40, "P026": 40}
    states = Counter(one.state for one in sections if one.pass_id == "P026")
    assert states["below"] >= 9
    assert states["normal"] >= 28


def test_the_same_recording_gives_the_same_bytes(model_file: Path) -> None:
    samples, config = tape(faulty([24, 25])), {"radio_anomaly": Config(model_file=str(model_file))}
    first, second = (replay_through(samples, [SERVICE], config) for _ in range(2))
    assert [(one.key, one.payload) for one in first] == [(one.key, one.payload) for one in second]


def test_an_empty_model_says_learning_and_raises_nothing() -> None:
    events, sections = said(tape(faulty([0, 1, 2])), Config())
    assert events == []
    assert {one.state for one in sections} == {"learning"}
    assert all(one.mean_dbm is None for one in sections)


def test_bad_measurements_are_refused_and_the_rest_goes_on(model_file: Path) -> None:
    rows = one_pass(24, change_db=-12.0, stretch=STRETCH)
    reset = type(rows[0])
    broken = [
        reset(t_ns=one.t_ns, pass_id=one.pass_id, radio="W1", channel="ch1", direction=one.direction,
              chainage_m=one.chainage_m, power_dbm=-900.0)
        for one in rows[::5]
    ]  # fmt: skip
    whole = sorted([*rows, *broken, *faulty([25])[0]], key=lambda one: one.t_ns)
    events, _ = said(tape([whole]), Config(model_file=str(model_file)))
    assert {one.kind for one in events if one.confirmed} == {"below"}


def test_snow_is_called_snow_where_it_is_reported(model_file: Path) -> None:
    passes = [one_pass(number, change_db=-9.0, stretch=(10, 30)) for number in (24, 25)]
    weather = [
        Weather(t_ns=each[0].t_ns - 10**9, axis_m=12_000.0, temperature_c=-3.0, snow_mm_per_h=1.0) for each in passes
    ]
    snowed, _ = said(tape(passes, *[(WEATHER, one) for one in weather]), Config(model_file=str(model_file)))
    last = {one.pass_id: one.cause for one in snowed if one.confirmed and one.kind == "below"}
    assert set(last.values()) == {"snow"}, "once a kilometre has fallen alike"
    dry, _ = said(tape(passes), Config(model_file=str(model_file)))
    assert "snow" not in {one.cause for one in dry}


def test_the_model_is_kept_and_goes_on_where_it_stopped(model_file: Path, tmp_path: Path) -> None:
    config = Config(model_file=str(model_file), state_folder=str(tmp_path))
    said(tape([one_pass(24), *faulty([25])]), config)
    kept = list((tmp_path / "radio_anomaly").glob("*.json"))
    assert len(kept) == 1
    assert [one.kind for one in read_model(kept[0]).events if one.confirmed] == ["below"]
    again, _ = said(tape(faulty([26])), config)
    assert {one.phase for one in again if one.kind == "below" and one.confirmed} == {"goes_on"}
    kept[0].write_text("{", "utf-8")
    fresh, _ = said(tape(faulty([26])), config)
    assert "began" in {one.phase for one in fresh}, "a damaged file is told in health, and the model given is taken"


def test_a_new_normal_is_taken_from_the_bus(model_file: Path) -> None:
    passes = faulty(range(24, 36))
    word = RadioAcceptance(
        t_ns=passes[6][0].t_ns - 10**9,
        acceptance_id="a1",
        radio="W1",
        section_start_m=1500.0,
        section_end_m=2500.0,
        since_ns=passes[0][0].t_ns,
        by="Sato",
    )
    events, _ = said(tape(passes, (RADIO_ACCEPTANCE, word)), Config(model_file=str(model_file)))
    sure = {one.pass_id for one in events if one.confirmed and one.kind == "below"}
    assert {"P025", "P027"} <= sure
    assert not {"P031", "P033", "P035"} & sure


def test_what_a_train_measures_without_its_place_is_no_sites_history(tmp_path: Path) -> None:
    begin_ns = one_pass(0)[0].t_ns
    rows = [
        RadioMeasurement(
            t_ns=begin_ns + k * 60 * 10**9, radio="T7", channel="ch1", decoded_power_dbm=-70.0 - 25.0 * (k > 90)
        )
        for k in range(120)
    ]
    samples = [sample(RADIO_MEASUREMENT, one, k, device="cab") for k, one in enumerate(rows)]
    assert said(samples, Config(state_folder=str(tmp_path))) == ([], [])
    assert read_model(next((tmp_path / "radio_anomaly").glob("*.json"))).sums == ()


def test_a_site_without_a_place_is_watched_over_time() -> None:
    rows = [
        Reading(
            t_ns=1_767_600_000 * 10**9 + k * 60 * 10**9,
            pass_id="",
            radio="T7",
            channel="ch1",
            decoded_power_dbm=-70.0 - (k % 3) * 0.5 - (25.0 if k >= 1440 else 0.0),
        )
        for k in range(1440 + 60)
    ]
    messages = [
        RadioMeasurement(
            t_ns=one.t_ns, radio="T7", channel="ch1", side="wayside", decoded_power_dbm=one.decoded_power_dbm
        )
        for one in rows
    ]
    samples = [sample(RADIO_MEASUREMENT, one, k, device="cab") for k, one in enumerate(messages)]
    events, _ = said(samples, Config())
    sure = [one for one in events if one.confirmed]
    assert {one.kind for one in sure} == {"below"}
    assert {one.direction for one in sure} == {None}
    # A day learned, then told within two periods of ten minutes.
    assert sure[0].t_ns <= rows[0].t_ns + DAY_NS + 21 * 60 * 10**9


def handed_down(path: Path, passes: int) -> Path:
    """A model learned from so many passes, as a bridge puts it in place."""
    write_model(
        path, learn([one for n in range(passes) for one in one_pass(n)], Settings(), "line", "made up", Counter())
    )
    return path


def test_a_newer_model_given_is_taken_over_and_an_open_event_goes_on(model_file: Path, tmp_path: Path) -> None:
    given = tmp_path / "current"
    given.write_bytes(model_file.read_bytes())
    config = Config(model_file=str(given), state_folder=str(tmp_path))
    word = RadioAcceptance(
        t_ns=one_pass(24)[0].t_ns, acceptance_id="a1", radio="W1", section_start_m=3000.0, section_end_m=3200.0,
        since_ns=one_pass(24)[0].t_ns, by="Sato",
    )  # fmt: skip
    said(tape([one_pass(24), *faulty([25])], (RADIO_ACCEPTANCE, word)), config)
    (kept,) = (tmp_path / "radio_anomaly").glob("*.json")
    before = read_model(kept)
    handed_down(given, 25)
    events, _ = said(tape(faulty([26])), config)
    after = read_model(kept)
    assert after.origin == read_model(given).origin
    assert after.origin.passes == before.origin.passes + 1
    assert [one.acceptance_id for one in after.acceptances] == ["a1"]
    assert {one.phase for one in events if one.kind == "below" and one.confirmed} == {"goes_on"}
    assert {one.event_id for one in after.events if one.confirmed} == {one.event_id for one in before.events}
    newest = max(row.day for row in read_model(given).sums)
    count = [sum(row.n for row in each.sums if row.day <= newest) for each in (read_model(given), after)]
    assert count[0] == count[1], "what both have learned counts once"


def told_after(config: Config, change: Callable[[], object]) -> tuple[tuple[str, ...], dict[str, int]]:
    """Reasons and counts of health a tick after a change to the files of a watch that runs."""
    with manual_loop() as loop:
        clock = ManualClock(loop, one_pass(26)[0].t_ns)
        node = MemoryNode(MemoryBus(), SERVICE, TRAIN, clock)

        async def watch() -> None:
            await SERVICE.run(node, config)

        task = loop.create_task(watch())
        loop.settle()
        assert node.health.level(clock.monotonic_s())[0] == "ok"
        change()
        loop.advance(TICK_S)
        found = node.health.level(clock.monotonic_s())[1], dict(node.health.counts)
        node.stop()
        loop.settle()
        assert task.done()
    return found


def test_a_newer_model_is_taken_over_while_the_watch_runs(model_file: Path, tmp_path: Path) -> None:
    given = tmp_path / "current"
    given.write_bytes(model_file.read_bytes())
    config = Config(model_file=str(given), state_folder=str(tmp_path))
    reasons, counts = told_after(config, lambda: handed_down(given, 26))
    assert [one for one in reasons if "from 26 passes is taken over" in one]
    assert counts["models_taken_over"] == 1
    (kept,) = (tmp_path / "radio_anomaly").glob("*.json")
    assert read_model(kept).origin.passes == 26


@pytest.mark.parametrize(
    ("content", "reason"),
    [("older", "older than the one kept"), ("{", "no radio model"), ("sections", "sections are of 50 m")],
)
def test_a_model_given_that_is_of_no_use_is_refused_and_the_kept_one_goes_on(
    model_file: Path, tmp_path: Path, content: str, reason: str
) -> None:
    given = tmp_path / "current"
    given.write_bytes(model_file.read_bytes())
    config = Config(model_file=str(given), state_folder=str(tmp_path))
    said(tape([one_pass(24), *faulty([25])]), config)
    (kept,) = (tmp_path / "radio_anomaly").glob("*.json")
    origin = read_model(kept).origin

    def change() -> None:
        if content == "older":
            handed_down(given, 10)
        elif content == "{":
            given.write_text(content, "utf-8")
        else:
            model = read_model(given)
            newer = msgspec.structs.replace(model.origin, passes=99)
            write_model(given, msgspec.structs.replace(model, origin=newer, settings=Settings(section_m=50.0)))

    reasons, counts = told_after(config, change)
    assert [one for one in reasons if "is not taken over" in one and reason in one]
    assert "models_taken_over" not in counts
    events, _ = said(tape(faulty([26])), config)
    assert {one.phase for one in events if one.kind == "below" and one.confirmed} == {"goes_on"}, "at a start, too"
    assert read_model(kept).origin == origin


def test_a_watch_learns_until_a_model_is_put_in_its_place(tmp_path: Path) -> None:
    given = tmp_path / "current"
    config = Config(model_file=str(given), state_folder=str(tmp_path))
    events, sections = said(tape(faulty([0])), config)
    assert events == []
    assert {one.state for one in sections} == {"learning"}
    handed_down(given, 24)
    events, _ = said(tape([one_pass(24), *faulty([25])]), config)
    assert "below" in {one.kind for one in events if one.confirmed}
