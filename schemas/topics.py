"""Every topic, once: key template, message type, delivery, nominal rate.

How keys are made of them, and topics found from keys: schemas/topic.py.
"""

from __future__ import annotations

from schemas import bridge, gnss, health, motion, position, radio, runs, track_circuit
from schemas.message import Message
from schemas.topic import ROOT, Address, Delivery, Topic, TopicError, TopicTable

GNSS_EPOCH = Topic(
    "train/{train}/gnss/{device}/epoch",
    gnss.Epoch,
    Delivery.STREAM,
    5.0,
    "what a GNSS receiver measured at one instant",
)
GNSS_EPHEMERIS = Topic(
    "train/{train}/gnss/{device}/ephemeris/{satellite}",
    gnss.Ephemeris,
    Delivery.STATE,
    None,
    "broadcast orbit and clock of one satellite",
)
GNSS_IONOSPHERE = Topic(
    "train/{train}/gnss/{device}/ionosphere",
    gnss.Ionosphere,
    Delivery.STATE,
    None,
    "broadcast Klobuchar coefficients",
)
GNSS_OWN_POSITION = Topic(
    "train/{train}/gnss/{device}/own_position",
    gnss.OwnPosition,
    Delivery.STATE,
    5.0,
    "where a receiver itself believes to be",
)
GNSS_VERDICT = Topic(
    "train/{train}/gnss/{device}/verdict",
    gnss.Verdicts,
    Delivery.STREAM,
    5.0,
    "multipath verdict of every satellite of one epoch",
)
GNSS_FIX = Topic(
    "train/{train}/gnss/{device}/fix", gnss.Fix, Delivery.STATE, 5.0, "position of a receiver's antenna, or why none"
)
GNSS_COMPARISON = Topic(
    "train/{train}/gnss/{device}/comparison/{method}",
    gnss.Fix,
    Delivery.STREAM,
    5.0,
    "the same epoch solved by another method, to compare",
)
GNSS_CORRECTION = Topic(
    "wayside/{wayside}/gnss/correction",
    gnss.Corrections,
    Delivery.STATE,
    1.0,
    "what is wrong with every satellite's pseudorange at a place beside the line",
)
GNSS_FRONT_END = Topic(
    "train/{train}/front_end",
    gnss.FrontEnd,
    Delivery.STATE,
    5.0,
    "front end of the train by all its antennas, and whether they agree",
)
TRAIN_TRUTH = Topic(
    "train/{train}/truth/{device}",
    position.TrainTruth,
    Delivery.STREAM,
    5.0,
    "where a simulated antenna really is",
)
IMU = Topic("train/{train}/imu/{device}", motion.ImuBlock, Delivery.STREAM, 10.0, "samples of an inertial sensor")
TACHO = Topic("train/{train}/tacho/{device}", motion.TachoBlock, Delivery.STREAM, 10.0, "counts of an axle's pulses")
MOTION_WARNING = Topic(
    "train/{train}/motion/warning/{device}",
    motion.MotionWarning,
    Delivery.KEPT,
    None,
    "something wrong with a motion sensor or its mounting",
)
ODOMETRY = Topic(
    "train/{train}/odometry", motion.Odometry, Delivery.STATE, 10.0, "way gone, speed, and their largest possible error"
)
SLIP_EPISODE = Topic(
    "train/{train}/slip", motion.SlipEpisode, Delivery.KEPT, None, "a slide or spin, from start point to re-adhesion"
)
WHEEL_SCALE = Topic(
    "train/{train}/wheel_scale", motion.WheelScale, Delivery.STATE, None, "scale of the wheels, told by references"
)
LANDMARK_MATCH = Topic(
    "train/{train}/landmark", position.LandmarkMatch, Delivery.KEPT, None, "a curve recognised or refused"
)
BRANCH_EVIDENCE = Topic(
    "train/{train}/branch", position.BranchEvidence, Delivery.STATE, None, "which branch the curvature speaks for"
)
BALISE = Topic("train/{train}/balise/{device}", position.BalisePassage, Delivery.EVENT, None, "a balise passed")
TRAIN_CHANGE = Topic(
    "train/{train}/change",
    position.TrainChange,
    Delivery.KEPT,
    None,
    "cab, length, wheels or route changed, as the train's equipment or a person says",
    from_outside=True,
)
TRAIN_POSITION = Topic(
    "train/{train}/position", position.TrainPosition, Delivery.STATE, 10.0, "where the train is, and where at worst"
)
REFERENCE_PASS = Topic(
    "train/{train}/reference_pass",
    position.ReferencePass,
    Delivery.KEPT,
    None,
    "error of the position at a balise or landmark, against its bound",
)
POSITION_EVENT = Topic(
    "train/{train}/position_event",
    position.PositionEvent,
    Delivery.KEPT,
    None,
    "resets, contradictions, changes of status of the position",
)
MOTION_TRUTH = Topic(
    "train/{train}/motion_truth",
    position.MotionTruth,
    Delivery.STREAM,
    10.0,
    "where a simulated train's front end really is",
)
SIMULATOR_FAULT = Topic(
    "train/{train}/simulator_fault",
    position.SimulatorFault,
    Delivery.EVENT,
    None,
    "a fault to be switched on or off in a simulated train",
    from_outside=True,
)
TRACK_SAMPLES = Topic(
    "{kind}/{place}/track_circuit/{circuit}/samples",
    track_circuit.SampleBlock,
    Delivery.STREAM,
    10.0,
    "samples of what a track circuit's receiver hears",
)
TRACK_TELEGRAM = Topic(
    "{kind}/{place}/track_circuit/{circuit}/telegram",
    track_circuit.Telegram,
    Delivery.EVENT,
    None,
    "a telegram received through the rail, or what came in its place",
)
TRACK_CODE = Topic(
    "{kind}/{place}/track_circuit/{circuit}/code",
    track_circuit.CodedCarrier,
    Delivery.STATE,
    1.0,
    "carrier and low-frequency code of a frequency-coded circuit",
)
TRACK_EQUALISER = Topic(
    "{kind}/{place}/track_circuit/{circuit}/equaliser",
    track_circuit.EqualiserState,
    Delivery.STREAM,
    1.0,
    "taps, error and constellation of a track circuit's receiver",
)
TRACK_OCCUPANCY = Topic(
    "{kind}/{place}/track_circuit/{circuit}/occupancy",
    track_circuit.CircuitOccupancy,
    Delivery.STATE,
    1.0,
    "whether a track circuit is certainly clear",
)
TRACK_HEALTH = Topic(
    "{kind}/{place}/track_circuit/{circuit}/health",
    track_circuit.CircuitHealth,
    Delivery.STATE,
    0.1,
    "level, leakage, drift and error rates of a track circuit, and where they are going",
)
TRACK_EVENT = Topic(
    "{kind}/{place}/track_circuit/{circuit}/event",
    track_circuit.CircuitEvent,
    Delivery.KEPT,
    None,
    "occupied, cleared, telegrams lost and back, trends and disturbances of a track circuit",
)
TRACK_CONFIRMATION = Topic(
    "{kind}/{place}/track_circuit/{circuit}/confirmation",
    track_circuit.ClearConfirmation,
    Delivery.EVENT,
    None,
    "a person's word that a circuit is clear now",
    from_outside=True,
)
RADIO_READING = Topic(
    "{kind}/{place}/radio/{device}/reading",
    radio.RadioMeasurement,
    Delivery.EVENT,
    2.0,
    "what a radio device itself reports, before its place is joined",
)
RADIO_MEASUREMENT = Topic(
    "{kind}/{place}/radio/{device}/measurement",
    radio.RadioMeasurement,
    Delivery.KEPT,
    2.0,
    "powers, reception and condition of one radio channel",
)
RADIO_EVENT = Topic(
    "{kind}/{place}/radio/{device}/event",
    radio.RadioEvent,
    Delivery.KEPT,
    None,
    "a stretch whose radio is not as it was learned, with cause and reason",
)
RADIO_SECTION = Topic(
    "{kind}/{place}/radio/{device}/section",
    radio.RadioSection,
    Delivery.STREAM,
    1.0,
    "a section of the line as the newest pass heard it, beside what is normal there",
)
RADIO_ACCEPTANCE = Topic(
    "{kind}/{place}/radio_acceptance",
    radio.RadioAcceptance,
    Delivery.KEPT,
    None,
    "a person's word that a stretch has a new normal, or that it is taken back",
    from_outside=True,
)
WEATHER = Topic(
    "{kind}/{place}/weather",
    radio.Weather,
    Delivery.KEPT,
    0.01,
    "weather at a place of the line",
)
RUN_RECORD = Topic(
    "train/{train}/run",
    runs.RunRecord,
    Delivery.KEPT,
    None,
    "running time and traction energy of a leg from station to station",
)
BRIDGE_STATUS = Topic(
    "{kind}/{place}/bridge/{bridge}", bridge.BridgeStatus, Delivery.STATE, 1.0, "backlog, delay and losses of a bridge"
)
DOCUMENT = Topic(
    "cloud/{cloud}/document/{document}",
    bridge.Document,
    Delivery.KEPT,
    None,
    "a file for trains and wayside sites: line, landmarks, thresholds, radio model",
    from_outside=True,
)
HEALTH = Topic("{kind}/{place}/health/{service}", health.Health, Delivery.STATE, 1.0, "how one service is doing")
SERVICE_EVENT = Topic(
    "{kind}/{place}/event/{service}",
    health.ServiceEvent,
    Delivery.KEPT,
    None,
    "started, stopping, failed, a gap or a restart seen at an input",
)

ALL: tuple[Topic[Message], ...] = tuple(found for found in globals().copy().values() if isinstance(found, Topic))
"""All that stand above, in their order."""
EVERYTHING = f"{ROOT}/**"
TABLE = TopicTable(ALL)


def topic_of(key: str) -> Address | None:
    """Topic, place and fields of a concrete key; None when no topic has it."""
    return TABLE.find(key)


def topic_at(key: str) -> Topic[Message]:
    """Topic that has a concrete key. Raises TopicError when none has."""
    address = TABLE.find(key)
    if address is None:
        msg = f"no topic has the key {key}"
        raise TopicError(msg)
    return address.topic


def topic_named(name: str) -> Topic[Message]:
    """Topic by its short name, its schema name or its template. TopicError names the known ones."""
    for topic in ALL:
        if name in (topic.name, topic.schema_name, topic.template):
            return topic
    msg = f"no topic {name!r}; there are: {', '.join(topic.name for topic in ALL)}"
    raise TopicError(msg)
