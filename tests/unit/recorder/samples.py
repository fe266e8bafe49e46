"""Samples to record, made up."""

from __future__ import annotations

from hypothesis import strategies as st

from schemas import topics
from schemas.codec import encode
from schemas.position import TrainTruth
from schemas.topic import Place
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.node import Sample

TRAIN = Place("demo", "train", "T1")
START_NS = 1_772_359_200_000_000_000
"""2026-03-01T10:00:00Z."""
TICK_NS = 200_000_000


def truth_sample(index: int, device: str = "front", boot_id: str = "boot-1") -> Sample:
    """The `index`-th of a 5 Hz series."""
    t_ns = START_NS + index * TICK_NS
    message = TrainTruth(
        t_ns=t_ns, lat_deg=35.0, lon_deg=135.0, h_m=0, ve_mps=0, vn_mps=0, vu_mps=0, axis_m=index * 3.0, speed_mps=15.0
    )
    attachment = encode_attachment(Attachment("demo/train/T1/simulator", boot_id, index, t_ns + 100_000))
    return Sample(topics.TRAIN_TRUTH.at(TRAIN, device=device), encode(message), attachment, t_ns + 300_000)


_NAMES = st.text(alphabet="abcXYZ019_.@+-", min_size=1, max_size=8).filter(lambda text: text[0].isalnum())
_KEYS = st.one_of(
    st.builds(lambda name: topics.GNSS_EPOCH.at(TRAIN, device=name), _NAMES),
    st.builds(lambda name: topics.HEALTH.at(TRAIN, service=name), _NAMES),
    st.sampled_from(["kirotei/v1/demo/train/T1/from/the/future", "somebody/else", "鉄道/キロ程"]),
)
_MARKS = st.builds(
    lambda source, boot_id, sequence, sent_ns: encode_attachment(Attachment(source, boot_id, sequence, sent_ns)),
    st.text(max_size=6),
    st.text(max_size=6),
    st.one_of(st.integers(-1, 5), st.integers(2**32 - 2, 2**32 + 2)),
    st.one_of(st.integers(-1, 2**63 - 1), st.just(2**64 - 1)),
)
any_sample = st.builds(
    Sample,
    _KEYS,
    st.binary(max_size=300),
    st.one_of(st.just(b""), _MARKS, st.binary(max_size=20)),
    st.one_of(st.integers(0, 2**64 - 1), st.integers(START_NS, START_NS + 10)),
)
"""Whatever can arrive: known and unknown keys, our marks, odd marks, none, times in any order."""
