# Two commands matter to a newcomer: `make demo` and `make test`. Nothing but Python 3.11+ is needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help demo demo-radio test lint types lock bench clean

help:
	@echo "make demo    watch a simulated train run a whole line (Ctrl-C ends it)"
	@echo "make demo-radio    faults of its radios are found, told, bridged over an outage and remembered"
	@echo "make test    run the tests"
	@echo "make lint    check style            make types   check types"
	@echo "make bench   measure against peers  make lock    pin the dependencies anew (needs uv)"

demo: $(READY)
	$(BIN)/kirotei demo

demo-radio: $(READY)
	$(BIN)/kirotei demo --scene radio

test: $(READY)
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

bench: $(READY) .venv-peers/.ready
	$(BIN)/kirotei bench

lock:
	UV_CUSTOM_COMPILE_COMMAND='make lock' uv pip compile -q --universal --generate-hashes pyproject.toml -o requirements/run.lock
	UV_CUSTOM_COMPILE_COMMAND='make lock' uv pip compile -q --universal --generate-hashes --group dev -c requirements/run.lock pyproject.toml -o requirements/dev.lock
	UV_CUSTOM_COMPILE_COMMAND='make lock' uv pip compile -q --universal --generate-hashes --group peers -o requirements/peers.lock

$(READY): requirements/dev.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "Kirotei needs Python 3.11 or newer; give one with: make PYTHON=python3.12 …")'
	@echo "Installing into $(VENV) (about half a minute, once) …"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install -q --disable-pip-version-check --no-compile --only-binary :all: --require-hashes -r requirements/dev.lock
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $(READY)

# What Kirotei is measured against lives apart, so that it changes nothing here.
.venv-peers/.ready: requirements/peers.lock
	@test -x .venv-peers/bin/python || $(PYTHON) -m venv .venv-peers
	@.venv-peers/bin/python -m pip install -q --disable-pip-version-check --only-binary :all: --require-hashes -r requirements/peers.lock
	@touch $@

clean:
	rm -rf $(VENV) .venv-peers dist .mypy_cache .ruff_cache .pytest_cache
