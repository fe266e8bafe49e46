"""`kirotei track-circuit`: telegrams out of recordings, and coefficients learned in trial runs."""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from services.runtime.progress import progress_of
from services.runtime.settings_table import settings_table
from services.runtime.told_command import UsageError, told
from services.track_circuit import watch_command

if TYPE_CHECKING:
    from services.track_circuit.circuit_reception import Received
    from services.track_circuit.circuit_samples import Recording
    from services.track_circuit.profile import Profile
    from services.track_circuit.receiver import StoredTaps
    from services.track_circuit.settings import CircuitSettings, Config

app = typer.Typer(
    name="track-circuit",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Track circuits: telegrams, bits and codes out of recordings; coefficients from trial runs.",
)
app.command()(watch_command.watch)
RecordingPath = Annotated[
    Path, typer.Argument(help="Recording: .sigmf-meta, .wav, or - for raw 16-bit samples on standard input.")
]
CircuitName = Annotated[str | None, typer.Option(help="Circuit whose settings and stored coefficients are used.")]
ConfigPath = Annotated[Path | None, typer.Option(help="TOML file whose [track_circuit] table names circuits.")]
StorePath = Annotated[Path | None, typer.Option(help="File of stored coefficients; default: in the state folder.")]
ReceiverOption = Annotated[str | None, typer.Option(help="mlse, dfe, least-squares, rls, nlms or lms.")]
Channel = Annotated[int, typer.Option(min=0, help="Channel of the recording, counted from 0.")]
Rate = Annotated[float, typer.Option(min=1000.0, help="Samples per second on standard input.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def _on_one_core() -> None:
    """Keep linear algebra on one core: the matrices are so small that threads cost four times what they do."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def configured(path: Path | None) -> Config:
    """Settings from the [track_circuit] table of a TOML file. Raises UsageError, OSError."""
    from services.runtime.config_check import Faults, converted
    from services.track_circuit.settings import Config

    if path is None:
        return Config()
    faults = Faults()
    config = converted(settings_table(path, "track_circuit"), Config, faults)
    if config is None:
        told_faults = (f"{path}: track_circuit.{'.'.join(spot)}: {words}" for spot, words in faults.found)
        raise UsageError("; ".join(told_faults))
    return config


def recording_of(path: Path, channel: int, rate_hz: float) -> Recording:
    """A recording by its path. Raises SampleError, OSError."""
    from services.track_circuit.raw_stream import read_raw
    from services.track_circuit.sigmf_file import read_sigmf
    from services.track_circuit.wav_file import read_wav

    if str(path) == "-":
        return read_raw(rate_hz)
    if path.suffix.lower() in (".wav", ".wave"):
        return read_wav(path, channel)
    return read_sigmf(path, channel)


def _settings(config: Config, config_path: Path | None, circuit: str | None) -> CircuitSettings | None:
    found = next((one for one in config.circuits if one.name == circuit), None)
    if circuit is not None and config_path is not None and found is None:
        names = ", ".join(one.name for one in config.circuits) or "none"
        msg = f"{config_path}: no circuit {circuit!r}; there are: {names}"
        raise UsageError(msg)
    return found


def _profile(recording: Recording, settings: CircuitSettings | None) -> Profile:
    from services.track_circuit.profile import decode_profile

    if settings is not None:
        return settings.profile
    if recording.profile is None:
        msg = f"{recording.name}: brings no profile; give --circuit NAME with --config FILE"
        raise UsageError(msg)
    return decode_profile(recording.profile)


def _stored(
    store: Path, circuit: str | None, profile: Profile, receiver: str
) -> tuple[StoredTaps | None, str, int | None]:
    """Coefficients to begin with, a note on them, and their version."""
    from services.track_circuit.coefficients import choose, taps_of
    from services.track_circuit.coefficients_store import read_store

    if circuit is None or profile.scheme == "fsk":
        return None, "", None
    choice = choose(read_store(store), circuit, profile, receiver)
    if choice.chosen is None:
        return None, choice.reason, None
    return taps_of(choice.chosen), "", choice.chosen.version


def _store_path(store: Path | None) -> Path:
    from services.runtime.state_dir import state_dir
    from services.track_circuit.coefficients_store import store_path

    return store if store is not None else store_path(state_dir(os.environ))


def _receiver(name: str | None, settings: CircuitSettings | None, profile: Profile) -> str:
    from services.track_circuit.demodulator_choice import receiver_used
    from services.track_circuit.receiver_choice import RECEIVERS

    chosen = name or (settings.receiver if settings is not None else RECEIVERS[0])
    if chosen not in RECEIVERS:
        msg = f"--receiver {chosen}: there are {', '.join(RECEIVERS)}"
        raise UsageError(msg)
    return receiver_used(profile, chosen)


def _result(received: Received, recording: Recording, profile: Profile, receiver: str) -> dict[str, Any]:
    """Everything worth telling, as plain numbers."""
    import numpy as np

    states: dict[str, int] = {}
    for row in received.rows:
        states[row.state] = states.get(row.state, 0) + 1
    result: dict[str, Any] = {
        "recording": recording.name,
        "scheme": profile.scheme,
        "duration_s": round(recording.duration_s, 3),
        "rows": len(received.rows),
        "states": states,
        "warnings": received.warnings,
    }
    if profile.scheme == "fsk":
        good = [row for row in received.rows if row.state == "good"]
        if good:
            last = good[-1]
            result |= {"carrier_hz": last.carrier_hz, "code_hz": last.code_hz, "meaning": last.meaning}
            result |= {"margin_db": round(min(row.margin_db or 0.0 for row in good), 1)}
        return result
    heard = [one for one in received.pieces if len(one.bit)]
    result |= {"receiver": receiver, "symbols": received.symbols, "refused": received.refused}
    if heard:
        result |= {
            "evm_db": round(float(np.mean(np.concatenate([one.evm_db for one in heard]))), 2),
            "level_db": round(float(np.mean(np.concatenate([one.level_db for one in heard]))), 2),
            "carrier_offset_hz": round(float(heard[-1].carrier_offset_hz[-1]), 3),
            "clock_offset_ppm": round(float(heard[-1].clock_offset_ppm[-1]), 2),
            "losses": sum(one.losses for one in heard),
            "blanked": sum(one.blanked for one in heard),
            "lines_hz": sorted({round(hz, 2) for one in heard for hz in one.lines_hz}),
        }
    return result


def _summary(result: dict[str, Any], out: Path) -> str:
    states = ", ".join(f"{count} {state}" for state, count in sorted(result["states"].items()))
    lines = [f"{out}: {result['rows']} rows of {result['duration_s']:.1f} s{': ' + states if states else ''}"]
    if "code_hz" in result:
        meaning = f" ({result['meaning']})" if result["meaning"] else ""
        lines.append(
            f"carrier {result['carrier_hz']:.2f} Hz, code {result['code_hz']:.1f} Hz{meaning}, "
            f"the next likely code {result['margin_db']:.1f} dB below"
        )
    if result.get("symbols"):
        lines.append(
            f"{result['symbols']} symbols, receiver {result['receiver']}, EVM {result['evm_db']:.1f} dB, level "
            f"{result['level_db']:.1f} dB, carrier {result['carrier_offset_hz']:+.2f} Hz, "
            f"clock {result['clock_offset_ppm']:+.1f} ppm"
        )
    return "\n".join(lines)


@app.command()
def demodulate(
    recording: RecordingPath,
    out: Annotated[Path, typer.Option(help="telegrams.csv to write.")],
    bits: Annotated[Path | None, typer.Option(help="bits.csv to write: number, bit and soft value.")] = None,
    circuit: CircuitName = None,
    config: ConfigPath = None,
    store: StorePath = None,
    receiver: ReceiverOption = None,
    channel: Channel = 0,
    rate: Rate = 48_000.0,
    plot: Annotated[
        Path | None, typer.Option(help="Picture to write, .png or .svg: waveform, error, telegrams.")
    ] = None,
    *,
    as_json: AsJson = False,
) -> None:
    """Telegrams and bits, or carrier and code, out of a recording.

    Set by the profile in the recording, or by --circuit NAME from a configuration.

    Example: kirotei track-circuit demodulate run.sigmf-meta --out telegrams.csv --plot run.svg
    """
    _on_one_core()
    with told("track-circuit demodulate"):
        if plot is not None and plot.suffix.lower() not in (".png", ".svg"):
            msg = f"--plot: {plot} is neither .png nor .svg"
            raise UsageError(msg)
        from services.track_circuit.circuit_reception import receive_recording
        from services.track_circuit.telegrams_file import write_bits, write_telegrams

        settings_of = configured(config)
        settings = _settings(settings_of, config, circuit)
        read = recording_of(recording, channel, rate)
        profile = _profile(read, settings)
        name = _receiver(receiver, settings, profile)
        stored, note, version = _stored(_store_path(store), circuit, profile, name)
        with progress_of(f"demodulating {recording.name}") as progress:
            received = receive_recording(
                read,
                profile,
                circuit=circuit or read.circuit or recording.stem,
                circuit_id=settings.circuit_id if settings else None,
                receiver=name,
                stored=stored,
                table=settings_of.code_table,
                progress=progress,
            )
        received.warnings += [note] if note else []
        result = _result(received, read, profile, name) | {"stored_version": version}
        write_telegrams(out, received.rows, coded=profile.scheme == "fsk")
        if bits is not None:
            write_bits(bits, received)
        for warning in received.warnings:
            typer.echo(f"warning: {warning}", err=True)
        _fail_without_signal(received, profile, read)
        if plot is not None:
            from services.track_circuit.reception_plot import draw_reception, save_picture

            save_picture(plot, draw_reception(received, read, profile, stored))
    typer.echo(json.dumps(result, indent=2) if as_json else _summary(result, out))


def _fail_without_signal(received: Received, profile: Profile, read: Recording) -> None:
    """Raise ValueError where a recording held nothing: exit 1, with the empty tables written."""
    if received.refused:
        msg = f"{read.name}: {received.refused}"
        raise ValueError(msg)
    if profile.scheme == "fsk" and not any(row.state != "no_signal" for row in received.rows):
        msg = f"{read.name}: no coded carrier (the shortest that can be judged is 1.9 s)"
        raise ValueError(msg)


@app.command()
def train(
    recording: RecordingPath,
    circuit: Annotated[str, typer.Option(help="Circuit for which coefficients are stored.")],
    config: ConfigPath = None,
    store: StorePath = None,
    receiver: ReceiverOption = None,
    weather: Annotated[str, typer.Option(help="Weather of the trial run, kept beside the coefficients.")] = "",
    distance: Annotated[
        float | None, typer.Option(min=0.0, help="On board: metres from the sending end; learns for its stretch alone.")
    ] = None,
    channel: Channel = 0,
    rate: Rate = 48_000.0,
    *,
    as_json: AsJson = False,
) -> None:
    """Learn a circuit's initial coefficients from a trial run, and keep them.

    Example: kirotei track-circuit train trial.sigmf-meta --circuit T12 --weather dry
    """
    _on_one_core()
    with told("track-circuit train"):
        from services.track_circuit.circuit_reception import receive_recording
        from services.track_circuit.coefficients import distance_bin, learned, with_set
        from services.track_circuit.coefficients_store import read_store, write_store

        settings = _settings(configured(config), config, circuit)
        read = recording_of(recording, channel, rate)
        profile = _profile(read, settings)
        name = _receiver(receiver, settings, profile)
        if profile.scheme == "fsk":
            msg = f"{read.name}: frequency-coded circuits have no equaliser to be trained"
            raise UsageError(msg)
        path = _store_path(store)
        before = read_store(path)
        with progress_of(f"training {circuit}") as progress:
            received = receive_recording(read, profile, circuit=circuit, receiver=name, progress=progress)
        for warning in received.warnings:
            typer.echo(f"warning: {warning}", err=True)
        longest = max(received.pieces, key=lambda one: len(one.bit))
        # The file's own date would be the copy's: recordings carry theirs, else today's holds.
        stamp_ns = read.stretches[0].t_ns
        day = (datetime.fromtimestamp(stamp_ns * 1e-9, UTC) if stamp_ns else datetime.now(UTC)).date()
        stretch = None if distance is None else distance_bin(distance)
        new = learned(longest, profile, circuit, day.isoformat(), weather, stretch)
        after, kept = with_set(before, new)
        write_store(path, after)
    if as_json:
        result = {"store": str(path), "circuit": circuit, "version": kept.version, "receiver": kept.receiver}
        result |= {"mse": kept.mse, "symbols": kept.symbols, "level_db": kept.level_db, "taps": len(kept.taps)}
        typer.echo(json.dumps(result, indent=2))
        return
    typer.echo(
        f"{path}: circuit {circuit}, version {kept.version}: {len(kept.taps)} coefficients of receiver "
        f"{kept.receiver} from {kept.symbols} symbols, mean square error {kept.mse:.2g}"
    )
