"""The stock `zenoh` command reads and writes Kirotei's messages through the `kirotei` codec."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from schemas import topics
from schemas.codec import decode, encode, encode_json
from schemas.gnss import Fix
from schemas.topic import Place
from services.runtime.host_config import RouterConfig
from services.runtime.router import open_router
from tests.unit.schemas.examples import EXAMPLES
from tests.wire.ports import free_port

ZENOH = str(Path(sys.executable).with_name("zenoh"))
KEY = topics.GNSS_FIX.at(Place("demo", "train", "T1"), device="front")
FIX = EXAMPLES[Fix]


def client(port: int) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


@pytest.mark.parametrize("payload_ok", [True, False])
def test_subscribe_prints_messages_as_json(payload_ok: bool) -> None:  # noqa: FBT001 - a parameter of the test
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with open_router(RouterConfig(listen=(endpoint,))), client(port) as session:
        command = [ZENOH, "--mode", "client", "--connect", endpoint]
        command += ["subscribe", "-k", "kirotei/v1/**", "--decoder", "kirotei", "--line", "{key} {value}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={"PYTHONUNBUFFERED": "1"}) as process:
            assert process.stdout is not None
            try:
                publisher = session.declare_publisher(KEY)
                matching = publisher.declare_matching_listener()
                while not publisher.matching_status.matching:  # type: ignore[attr-defined]  # the stub says bool
                    matching.recv()
                publisher.put(encode(FIX) if payload_ok else b"\xc1garbage")
                key, _, value = process.stdout.readline().partition(" ")
            finally:
                process.terminate()
    assert key == KEY
    if payload_ok:
        assert json.loads(value) == json.loads(encode_json(FIX))
    else:
        assert "cannot decode" in value


def test_put_encodes_json_as_a_message() -> None:
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with open_router(RouterConfig(listen=(endpoint,))), client(port) as session:
        subscriber = session.declare_subscriber(KEY)
        text = encode_json(FIX).decode()
        command = [ZENOH, "--mode", "client", "--connect", endpoint, "put", "-k", KEY, "-v", text]
        subprocess.run([*command, "--encoder", "kirotei"], check=True, timeout=30)
        sample = subscriber.recv()
    assert decode(Fix, sample.payload.to_bytes()) == FIX
