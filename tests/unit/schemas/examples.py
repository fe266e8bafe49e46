"""One example of every message, and the writer of the kept bytes.

`python -m tests.unit.schemas.examples` adds bytes of messages that have none yet, or whose
fields have grown. Bytes once kept are never changed: they are what older senders send.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from schemas import topics
from schemas.codec import encode, encode_json
from schemas.gnss import (
    Corrections,
    Ephemeris,
    Epoch,
    Fix,
    FrontEnd,
    Ionosphere,
    KeplerOrbit,
    OwnPosition,
    SatelliteCorrection,
    SatelliteRefusal,
    SatelliteVerdict,
    Verdicts,
)
from schemas.health import Health, InputHealth, ServiceEvent
from schemas.message import Message
from schemas.motion import ImuBlock, MotionWarning, Odometry, SlipEpisode, TachoBlock, WheelScale
from schemas.position import (
    BalisePassage,
    BranchChance,
    BranchEvidence,
    LandmarkMatch,
    MotionTruth,
    PositionEvent,
    ReferencePass,
    SimulatorFault,
    SourceState,
    Stretch,
    TrainChange,
    TrainPosition,
    TrainTruth,
)
from schemas.track_circuit import (
    CircuitEvent,
    CircuitHealth,
    CircuitOccupancy,
    ClearConfirmation,
    CodedCarrier,
    EqualiserState,
    SampleBlock,
    Telegram,
)

_T_NS = 1_465_211_424_700_000_000

EXAMPLES: dict[type[Message], Message] = {
    Epoch: Epoch(
        t_ns=_T_NS,
        gps_week=1900,
        tow_s=126641.7,
        satellites=("G05", "E11"),
        signals=("1C", "1C"),
        pseudorange_m=np.array([2.1e7, 2.4e7]),
        carrier_phase_cycles=np.array([1.1e8, np.nan]),
        doppler_hz=np.array([-1200.5, 300.25]),
        cn0_dbhz=np.array([45.0, 38.0]),
        lock_lost=np.array([0, 1], np.uint8),
    ),
    Ephemeris: Ephemeris(
        t_ns=_T_NS,
        satellite="G05",
        gps_week=1900,
        toe_s=129600.0,
        toc_s=129600.0,
        clock_bias_s=1e-5,
        clock_drift=1e-12,
        healthy=True,
        fit_interval_s=7200.0,
        orbit=KeplerOrbit(
            sqrt_a=5153.6,
            eccentricity=0.01,
            m0_rad=0.5,
            delta_n_radps=4e-9,
            omega0_rad=1.0,
            omega_dot_radps=-8e-9,
            omega_rad=0.7,
            i0_rad=0.96,
            i_dot_radps=1e-10,
            cuc_rad=1e-6,
            cus_rad=1e-6,
            crc_m=200.0,
            crs_m=20.0,
            cic_rad=1e-8,
            cis_rad=1e-8,
        ),
    ),
    Ionosphere: Ionosphere(t_ns=_T_NS, alpha=(1e-8, 2e-8, -6e-8, -1e-7), beta=(8e4, 1e5, -6e4, -5e5)),
    OwnPosition: OwnPosition(
        t_ns=_T_NS,
        protocol="nmea",
        status="fix",
        mode="differential",
        lat_deg=52.5,
        lon_deg=13.37,
        h_m=76.0,
        ve_mps=1.5,
        vn_mps=-0.5,
        satellites_used=9,
        hdop=0.9,
        sigma_horizontal_m=1.2,
        correction_age_s=2.0,
    ),
    Verdicts: Verdicts(
        t_ns=_T_NS,
        gps_week=1900,
        tow_s=126641.7,
        satellites=(
            SatelliteVerdict(satellite="G05", used=True, flagged=False, reason="clean", elevation_rad=0.8),
            SatelliteVerdict(satellite="E11", used=False, flagged=True, multipath_probability=0.9, reason="change"),
        ),
    ),
    Fix: Fix(
        t_ns=_T_NS,
        gps_week=1900,
        tow_s=126641.7,
        method="adjust",
        status="fix",
        lat_deg=52.5,
        lon_deg=13.37,
        h_m=76.0,
        satellites_used=7,
        satellites_flagged=2,
    ),
    Corrections: Corrections(
        t_ns=_T_NS,
        station="depot",
        gps_week=1900,
        tow_s=126641.7,
        lat_deg=52.5,
        lon_deg=13.37,
        h_m=76.0,
        satellites=(
            SatelliteCorrection(
                satellite="G05",
                signal="1C",
                issue=17,
                toe_week=1900,
                toe_s=129600.0,
                correction_m=-4.25,
                rate_mps=0.001,
                sigma_m=0.3,
                elevation_rad=0.8,
                smoothed_s=100.0,
            ),
        ),
        refused=(SatelliteRefusal(satellite="E11", reason="below the elevation mask"),),
    ),
    FrontEnd: FrontEnd(
        t_ns=_T_NS,
        devices=("front", "rear"),
        agreement="agree",
        reason="front and rear are 99.0 m apart, 100.0 m on the train",
        chainage_m=12_345.6,
        chainage_bound_m=8.5,
        facing="up",
        difference_m=1.0,
        allowed_m=17.0,
    ),
    TrainTruth: TrainTruth(
        t_ns=_T_NS,
        lat_deg=34.7,
        lon_deg=135.5,
        h_m=40.0,
        ve_mps=1.0,
        vn_mps=2.0,
        vu_mps=0.0,
        axis_m=1234.5,
        speed_mps=2.2,
        surroundings="street canyon",
    ),
    ImuBlock: ImuBlock(
        t_ns=_T_NS,
        first_sample=1200,
        offset_ns=np.array([-10_000_000, 0]),
        ax_mps2=np.array([0.3, 0.31]),
        ay_mps2=np.array([0.0, -0.1]),
        az_mps2=np.array([9.8, 9.79]),
        gx_radps=np.array([0.0, 0.001]),
        gy_radps=np.array([0.0, np.nan]),
        gz_radps=np.array([0.01, 0.011]),
        temperature_c=31.5,
    ),
    TachoBlock: TachoBlock(
        t_ns=_T_NS,
        first_sample=77,
        offset_ns=np.array([-100_000_000, 0]),
        pulses=np.array([123456, 123531]),
        pulses_per_revolution=90.0,
        wheel_diameter_m=0.816,
    ),
    Odometry: Odometry(
        t_ns=_T_NS,
        method="fused",
        origin="3f2a",
        distance_m=1523.4,
        way_m=1523.4,
        speed_mps=18.2,
        speed_bound_mps=0.4,
        bound_m=12.5,
        share_bound=0.006,
        excess_m=2.0,
        status="valid",
        curvature_per_m=0.0025,
        curvature_distance_m=1505.2,
    ),
    SlipEpisode: SlipEpisode(
        t_ns=_T_NS,
        origin="3f2a",
        episode=3,
        phase="ended",
        slip=-1,
        start_t_ns=_T_NS - 9_000_000_000,
        correction_s=9.0,
        corrected_m=14.2,
        bound_m=6.1,
        stop_demanded=False,
        reason="wheel and inertial sensor agree again",
    ),
    WheelScale: WheelScale(t_ns=_T_NS, scale=0.9942, sigma=0.0012, references=3, reason="landmark R300-4"),
    MotionWarning: MotionWarning(t_ns=_T_NS, device="imu0", kind="frozen", active=True, reason="gz same for 1.2 s"),
    LandmarkMatch: LandmarkMatch(
        t_ns=_T_NS,
        landmark="R300-4",
        direction="up",
        accepted=True,
        reason="accepted",
        origin="3f2a",
        distance_m=952.1,
        axis_m=953.0,
        correction_m=0.9,
        bound_m=4.0,
        database_version="2026-11",
        line_version="1",
    ),
    BranchEvidence: BranchEvidence(
        t_ns=_T_NS,
        junction_axis_m=8100.0,
        decided=None,
        chances=(BranchChance(branch="", probability=0.7), BranchChance(branch="harbour", probability=0.3)),
        reason="no curve passed since the junction",
    ),
    BalisePassage: BalisePassage(t_ns=_T_NS, balise="B12", sensor_offset_m=3.2),
    TrainChange: TrainChange(t_ns=_T_NS, kind="cab", cab="B"),
    TrainPosition: TrainPosition(
        t_ns=_T_NS,
        status="valid",
        reason="",
        branch="",
        axis_m=953.0,
        chainage_m=100953.0,
        direction="up",
        speed_mps=18.0,
        bound_ahead_m=4.0,
        bound_behind_m=4.0,
        max_safe_front_end_m=957.0,
        min_safe_front_end_m=949.0,
        min_safe_rear_end_m=889.0,
        train_length_m=60.0,
        occupied=(Stretch(branch="", start_axis_m=889.0, end_axis_m=957.0),),
        reference="R300-4",
        reference_distance_m=0.0,
        sources=(SourceState(source="landmark", taken=True, age_s=0.4, difference_m=0.9, allowed_m=8.0, reason=""),),
    ),
    ReferencePass: ReferencePass(
        t_ns=_T_NS,
        reference="R300-4",
        kind="landmark",
        axis_m=953.0,
        error_m=-0.9,
        bound_m=8.0,
        within=True,
        way_m=1200.0,
    ),
    PositionEvent: PositionEvent(t_ns=_T_NS, kind="reset", text="landmark R300-4: 0.9 m ahead", axis_m=953.0),
    MotionTruth: MotionTruth(
        t_ns=_T_NS,
        axis_m=953.0,
        chainage_m=100953.0,
        distance_m=953.0,
        speed_mps=18.0,
        acceleration_mps2=0.1,
        slip=0,
        gradient_permille=-16.0,
        curvature_per_m=0.0033,
    ),
    SimulatorFault: SimulatorFault(t_ns=_T_NS, kind="slide", duration_s=8.0),
    SampleBlock: SampleBlock(
        t_ns=_T_NS,
        first_sample=4800,
        sample_rate_hz=48_000.0,
        samples=np.array([0.5, -0.25], np.float32),
    ),
    Telegram: Telegram(
        t_ns=_T_NS,
        circuit="T12",
        scheme="ss-cdma",
        state="good",
        sequence=17,
        circuit_id=12,
        payload=b"\x01\x02",
        crc_ok=True,
        evm_db=-15.0,
        level_db=-20.5,
        receiver="mlse",
    ),
    CodedCarrier: CodedCarrier(
        t_ns=_T_NS,
        circuit="T12",
        state="good",
        carrier_hz=1701.4,
        code_hz=16.9,
        meaning="",
        level_db=-20.5,
        margin_db=18.0,
    ),
    EqualiserState: EqualiserState(
        t_ns=_T_NS,
        circuit="T12",
        receiver="mlse",
        taps=np.array([1.0 + 0.5j, 0.25 - 0.125j]),
        error_db=np.array([-10.0, -15.0]),
        constellation=np.array([0.9 + 0.1j, -1.1 - 0.1j]),
        snr_db=15.0,
        carrier_offset_hz=0.5,
        clock_offset_ppm=-12.0,
        from_store=True,
    ),
    CircuitOccupancy: CircuitOccupancy(
        t_ns=_T_NS,
        circuit="T12",
        state="occupied",
        reason="level 12.0 dB below the reference",
        level_db=-32.5,
        reference_db=-20.5,
        most_restrictive=True,
        since_ns=_T_NS - 5_000_000_000,
    ),
    CircuitHealth: CircuitHealth(
        t_ns=_T_NS,
        circuit="T12",
        level_db=-20.5,
        level_trend_db_per_day=-0.5,
        ballast_s_per_km=0.1,
        tap_drift=0.05,
        evm_db=-15.0,
        telegrams=120,
        crc_failures=3,
        stored_version=2,
    ),
    CircuitEvent: CircuitEvent(
        t_ns=_T_NS, circuit="T12", kind="occupied", text="level fell by 12.0 dB", level_db=-32.5
    ),
    ClearConfirmation: ClearConfirmation(t_ns=_T_NS, circuit="T12", by="signaller"),
    Health: Health(
        t_ns=_T_NS,
        service="gnss_receiver@rear",
        boot_id="3f2a",
        level="degraded",
        reasons=("2 missing",),
        uptime_s=12.5,
        published=60,
        received=0,
        dropped=0,
        refused=1,
        counts={"epochs": 60},
        inputs=(
            InputHealth(key="k", source="s", received=3, missing=2, duplicated=0, restarts=0, age_s=0.1, delay_s=0.002),
        ),
    ),
    ServiceEvent: ServiceEvent(t_ns=_T_NS, service="gnss_receiver", boot_id="3f2a", kind="started", text="ready"),
}


def keep_bytes(folder: Path) -> list[str]:
    """Write bytes and JSON of every example that no kept file covers; give the new names."""
    folder.mkdir(exist_ok=True)
    written = []
    for topic in topics.ALL:
        message = EXAMPLES[topic.message]
        fields = set(json.loads(encode_json(message)))
        kept = sorted(folder.glob(f"{topic.schema_name}.*.json"))
        if kept and set(json.loads(kept[-1].read_text("utf-8"))) == fields:
            continue
        name = f"{topic.schema_name}.{len(kept) + 1:03d}"
        (folder / f"{name}.msgpack").write_bytes(encode(message))
        (folder / f"{name}.json").write_bytes(encode_json(message))
        written.append(name)
    return written


if __name__ == "__main__":
    print(*keep_bytes(Path(__file__).parent / "old_bytes"), sep="\n")  # noqa: T201 - a script's output
