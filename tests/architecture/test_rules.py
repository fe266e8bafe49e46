"""The house rules (docs/architecture.md), read off the syntax trees."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from schemas import topics
from schemas.topic import Topic

ROOT = Path(__file__).parents[2]
SERVICES = ROOT / "services"
MODULES = sorted(path for path in SERVICES.rglob("*.py") if path.name != "__init__.py")
EDGE_SUFFIXES = ("_file", "_stream", "_store", "_plot", "_socket")
"""Endings of modules that touch files, sockets, databases or devices."""
OUTSIDE = {"asyncio", "zenoh", "time", "logging", "structlog", "socket", "sqlite3", "subprocess", "threading", "signal"}
"""What pure modules never import."""
FILES = {"pathlib", "os", "io", "tempfile", "shutil", "gzip", "mcap"}
"""What only edges (and services and commands) import besides."""


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def imports_of(path: Path) -> set[str]:
    """Full names of everything that a module imports, wherever the import stands."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def is_shell(path: Path) -> bool:
    """Services, commands, replays, the runtime and the command line: they may touch the world."""
    return (
        path.name == "service.py"
        or path.stem.endswith(("command", "_replay"))
        or path.name == "cli.py"
        or "runtime" in path.parts[len(ROOT.parts) :]
    )


def is_edge(path: Path) -> bool:
    return path.stem.endswith(EDGE_SUFFIXES)


PURE = [path for path in MODULES if not is_shell(path) and not is_edge(path)]
EDGES = [path for path in MODULES if is_edge(path) and not is_shell(path)]
SERVICE_FILES = sorted(SERVICES.glob("*/service.py"))


def test_there_is_something_to_check() -> None:
    assert len(PURE) > 10
    assert EDGES
    assert SERVICE_FILES


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_nobody_imports_a_service_but_the_runtime_and_the_command_line(path: Path) -> None:
    if path.name == "cli.py" or "runtime" in path.parts:
        return
    assert not [name for name in imports_of(path) if name.split(".")[-1] == "service" and name.startswith("services.")]


@pytest.mark.parametrize("path", SERVICE_FILES, ids=name_of)
def test_a_service_is_declared_under_the_name_of_its_folder(path: Path) -> None:
    calls = [
        node.value
        for node in ast.parse(path.read_text("utf-8")).body
        if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(node.value, ast.Call)
        if any(isinstance(t, ast.Name) and t.id == "SERVICE" for t in ast.walk(node))
    ]
    assert len(calls) == 1, "one SERVICE = Service(…)"
    arguments = [*calls[0].args, *(keyword.value for keyword in calls[0].keywords)]
    assert path.parent.name in [a.value for a in arguments if isinstance(a, ast.Constant)]


@pytest.mark.parametrize("path", PURE, ids=name_of)
def test_pure_modules_touch_nothing_outside(path: Path) -> None:
    roots = {name.split(".")[0] for name in imports_of(path)}
    assert not roots & (OUTSIDE | FILES)
    assert not [name for name in imports_of(path) if name.startswith("services.runtime")]
    opened = [
        node.lineno
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("open", "print", "input")
    ]
    assert not opened


@pytest.mark.parametrize("path", EDGES, ids=name_of)
def test_edges_know_nothing_of_the_bus(path: Path) -> None:
    roots = {name.split(".")[0] for name in imports_of(path)}
    assert not roots & {"zenoh", "asyncio", "structlog", "logging"}


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_zenoh_is_imported_in_the_runtime_alone(path: Path) -> None:
    if "zenoh" in {name.split(".")[0] for name in imports_of(path)}:
        assert path.parent.name == "runtime"
        assert "zenoh" in path.stem or path.stem in ("router", "liveliness")


@pytest.mark.parametrize("path", sorted((ROOT / "schemas").glob("*.py")), ids=name_of)
def test_schemas_depend_on_no_service(path: Path) -> None:
    assert not [name for name in imports_of(path) if name.split(".")[0] in {"services", *OUTSIDE}]


def topics_in(node: ast.AST) -> set[str]:
    """Names of topic constants that occur below a node, as `topics.X` or as `X`."""
    known = {name for name in vars(topics) if isinstance(getattr(topics, name), Topic)}
    names = {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
    names |= {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    return names & known


@pytest.mark.parametrize("path", SERVICE_FILES, ids=name_of)
def test_services_use_the_topics_that_they_declare(path: Path) -> None:
    from services.runtime.catalogue import load_service  # noqa: PLC0415 - services load when asked

    service = load_service(path.parent.name)
    declared = {topic.template for topic in (*service.reads, *service.writes)}
    tree = ast.parse(path.read_text("utf-8"))
    used = {
        getattr(topics, name).template
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute)
        if call.func.attr in ("publish", "arrivals", "messages")
        for argument in call.args
        for name in topics_in(argument)
    }
    assert used <= declared


def test_whatever_is_read_is_written_by_somebody() -> None:
    from services.runtime.catalogue import load_service  # noqa: PLC0415 - services load when asked

    services = [load_service(path.parent.name) for path in SERVICE_FILES]
    written = {topic for service in services for topic in service.writes} | {topics.HEALTH, topics.SERVICE_EVENT}
    written |= {topic for topic in topics.ALL if topic.from_outside}
    for service in services:
        assert set(service.reads) <= written, service.name
    assert {topic for topic in topics.ALL if not topic.from_outside} == {t for t in written if not t.from_outside}


def test_files_stay_short() -> None:
    lengths = {name_of(path): len(path.read_text("utf-8").splitlines()) for path in MODULES}
    assert {name: lines for name, lines in lengths.items() if lines > 350} == {}
