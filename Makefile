# make repro: the whole experiment at the default size. make test, make check: as in CI. All set up what they need.
SHELL := /bin/bash
PYTHON ?= python3
BIN := .venv/bin
export PATH := $(CURDIR)/$(BIN):$(PATH)

.PHONY: install install-benchmark repro test check clean discovery-benchmark discovery-benchmark-smoke real-motion

install: .venv/installed

.venv/installed: pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || (echo "error: Python 3.11 or newer is needed (make PYTHON=python3.12)"; exit 2)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt torch==2.13.0
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[test]"
	@touch $@

# data/samples and data/measured are in git and so may be gone after `rm -rf data`.
repro: install
	@test -d data/samples || git checkout -q -- data/samples
	@test -d data/measured || git checkout -q -- data/measured
	dvc repro
	@echo "the report: $(CURDIR)/reports/index.html"

test: install
	pytest -n 2

check: install
	ruff check .
	ruff format --check .
	mypy

install-benchmark: install
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[benchmark]"

# hours on 2 cores; stop it at any time, it goes on where it was
discovery-benchmark: install-benchmark
	python -m benchmarks.discovery

discovery-benchmark-smoke: install-benchmark
	python -m benchmarks.discovery --smoke

# published measurements: DYNAMICS_DATA is the folder that has real_motion
real-motion: install-benchmark
	python -m benchmarks.real_motion

clean:
	rm -rf data/[!ms]* data/m[!e]* data/s[!a]* reports/index.html .shards
