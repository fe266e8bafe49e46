"""The topic table: keys in both directions, refusals, no two templates that intersect."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import topics
from schemas.position import TrainTruth
from schemas.topic import Delivery, Place, Topic, TopicError, TopicTable, mirrored_key
from schemas.topics import topic_named, topic_of
from services.runtime.key_expression import intersects

NAMES = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.@+-]{0,20}", fullmatch=True)


def place_for(topic: Topic[object], line: str, name: str) -> Place:  # type: ignore[type-var]  # any topic
    kind = topic.template.split("/", 1)[0]
    return Place(line, "cloud" if kind == "{kind}" else kind, name)  # type: ignore[arg-type]  # a kind by its template


@given(st.sampled_from(topics.ALL), NAMES, NAMES, st.lists(NAMES, min_size=2, max_size=2))
def test_a_key_finds_its_topic_place_and_fields(topic: Topic, line: str, name: str, values: list[str]) -> None:  # type: ignore[type-arg]  # any
    place = place_for(topic, line, name)
    fields = dict(zip(topic.fields, values, strict=False))
    key = topic.at(place, **fields)
    address = topic_of(key)
    assert address is not None
    assert (address.topic, address.place, address.fields) == (topic, place, fields)
    assert intersects(topic.within(place), key)
    assert intersects(topic.anywhere(), key)
    assert intersects(topic.anywhere(line), key)
    assert intersects(topics.EVERYTHING, key)


@given(st.sampled_from(topics.ALL), st.sampled_from(topics.ALL))
def test_no_two_topics_share_a_key(one: Topic, other: Topic) -> None:  # type: ignore[type-arg]  # any
    if one is other:
        return
    place = place_for(one, "line", "x")
    key = one.at(place, **dict.fromkeys(one.fields, "x"))
    assert not intersects(other.anywhere(), key)


def test_intersecting_templates_are_refused() -> None:
    twice = Topic("train/{train}/{anything}/fix", TrainTruth, Delivery.STREAM, None, "")
    with pytest.raises(TopicError, match="intersects"):
        TopicTable((Topic("train/{train}/gnss/fix", TrainTruth, Delivery.STREAM, None, ""), twice))
    with pytest.raises(TopicError, match="twice"):
        TopicTable((twice, twice))


@pytest.mark.parametrize(
    "key",
    [
        "",
        "kirotei",
        "kirotei/v1/demo/train/T1",
        "kirotei/v2/demo/train/T1/gnss/front/fix",
        "kirotei/v1/demo/train/T1/gnss/front/unheard",
        "kirotei/v1/demo/ship/T1/gnss/front/fix",
        "kirotei/v1/demo/cloud/T1/gnss/front/fix",
        "kirotei/v1/de*mo/train/T1/gnss/front/fix",
        "kirotei/v1/demo/train/T1/gnss/front/fix/more",
        "kirotei/v1/demo/mirror",
        "kirotei/v1/demo/mirror/train/T1",
        "kirotei/v1/demo/mirror/mirror/train/T1/gnss/front/fix",
        "kirotei/v1/demo/train/mirror/gnss/fix",
    ],
)
def test_foreign_keys_have_no_topic(key: str) -> None:
    assert topic_of(key) is None


def test_a_mirrored_key_is_found_with_the_place_that_spoke_first() -> None:
    key = topics.GNSS_FIX.at(Place("demo", "train", "T1"), device="front")
    mirrored = mirrored_key(key)
    assert mirrored == "kirotei/v1/demo/mirror/train/T1/gnss/front/fix"
    address, again = topic_of(key), topic_of(mirrored)
    assert address is not None
    assert again == dataclasses.replace(address, mirrored=True)


@pytest.mark.parametrize(
    "key", ["", "kirotei/v1/demo/train/T1", "kirotei/v1/demo/mirror/train/T1/gnss/front/fix", "a/b"]
)
def test_other_keys_cannot_be_mirrored(key: str) -> None:
    with pytest.raises(TopicError, match="mirrored"):
        mirrored_key(key)


def test_readers_of_mirrored_keys_hear_nothing_twice() -> None:
    key = topics.GNSS_FIX.at(Place("demo", "train", "T1"), device="front")
    here, there = topics.GNSS_FIX.anywhere("demo"), topics.GNSS_FIX.anywhere("demo", mirrored=True)
    assert (intersects(here, key), intersects(there, key)) == (True, False)
    assert (intersects(here, mirrored_key(key)), intersects(there, mirrored_key(key))) == (False, True)


def test_what_cannot_stand_in_a_key_is_refused() -> None:
    with pytest.raises(TopicError, match="line 'a/b' cannot stand in a key"):
        Place("a/b", "train", "T1")
    with pytest.raises(TopicError, match="place kind"):
        Place("demo", "ship", "T1")  # type: ignore[arg-type]  # what is tested
    train = Place("demo", "train", "T1")
    with pytest.raises(TopicError, match="device"):
        topics.GNSS_FIX.at(train, device="front/*")
    with pytest.raises(TopicError, match="wants the fields"):
        topics.GNSS_FIX.at(train)
    with pytest.raises(TopicError, match="belongs to a train"):
        topics.GNSS_FIX.at(Place("demo", "cloud", "c"), device="front")


def test_topics_are_found_by_every_name_people_use() -> None:
    for topic in topics.ALL:
        assert topic_named(topic.name) is topic
        assert topic_named(topic.template) is topic
    with pytest.raises(TopicError, match="there are: gnss/epoch"):
        topic_named("gnss/fixx")
