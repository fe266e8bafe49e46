"""Two ClickHouse servers on loopback that know each other as the cluster `fleet`."""

from __future__ import annotations

import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from services.cloud_analyzer.clickhouse_socket import Node, UnreachableError
from tests.wire.ports import free_port

SERVER = shutil.which("clickhouse-server")
START_S = 30.0

CONFIG = """<?xml version="1.0"?>
<yandex>
  <logger><level>warning</level><log>{folder}/log</log><errorlog>{folder}/errors</errorlog></logger>
  <http_port>{http}</http_port><tcp_port>{tcp}</tcp_port><listen_host>127.0.0.1</listen_host>
  <path>{folder}/data/</path><tmp_path>{folder}/tmp/</tmp_path>
  <users_config>{folder}/users.xml</users_config>
  <default_profile>default</default_profile><default_database>default</default_database>
  <mark_cache_size>5368709120</mark_cache_size><timezone>UTC</timezone>
  <remote_servers><fleet>
    <shard><replica><host>127.0.0.1</host><port>{tcp}</port></replica></shard>
    <shard><replica><host>127.0.0.1</host><port>{other}</port></replica></shard>
  </fleet></remote_servers>
</yandex>
"""
USERS = """<?xml version="1.0"?>
<yandex>
  <profiles><default><connect_timeout_with_failover_ms>500</connect_timeout_with_failover_ms></default></profiles>
  <users><default><password></password><networks><ip>127.0.0.1</ip></networks>
    <profile>default</profile><quota>default</quota></default></users>
  <quotas><default/></quotas>
</yandex>
"""


@dataclass(slots=True)
class Server:
    """One running server."""

    url: str
    process: subprocess.Popen[bytes]

    def stop(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.wait(10.0)


def start_two(folder: Path) -> tuple[Server, Server]:
    """Two servers that answer."""
    ports = [(free_port(), free_port()) for _ in range(2)]
    return _start(folder / "a", ports[0], ports[1][1]), _start(folder / "b", ports[1], ports[0][1])


def _start(folder: Path, ports: tuple[int, int], other: int) -> Server:
    assert SERVER is not None
    folder.mkdir()
    http, tcp = ports
    (folder / "config.xml").write_text(CONFIG.format(folder=folder, http=http, tcp=tcp, other=other), "utf-8")
    (folder / "users.xml").write_text(USERS, "utf-8")
    process = subprocess.Popen(
        [SERVER, f"--config-file={folder}/config.xml"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=folder,
    )
    node = Node(f"http://127.0.0.1:{http}", timeout_s=2.0)
    until_s = time.monotonic() + START_S
    while True:
        try:
            assert node.rows("SELECT 1") == [[1]]
        except UnreachableError:
            assert time.monotonic() < until_s, (folder / "errors").read_text("utf-8", "replace")[-2000:]
            assert process.poll() is None
            time.sleep(0.1)
        else:
            node.close()
            return Server(node.url, process)
