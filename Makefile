# make repro: the whole experiment at the default size. make test and make check: what CI runs.
# Each target installs what it needs.
SHELL := /bin/bash
PYTHON ?= python3
BIN := .venv/bin
export PATH := $(CURDIR)/$(BIN):$(PATH)

.PHONY: install install-benchmark repro test test-app test-machines campaign check clean discovery-benchmark discovery-benchmark-smoke real-motion

install: .venv/installed

.venv/installed: pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || (echo "error: Python 3.11 or newer is needed (make PYTHON=python3.12)"; exit 2)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt torch==2.13.0
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[test]"
	@echo "compiling the functions that a first infer and edit need: a minute or two, once"
	@folder=$$(mktemp -d) && dynamics infer data/films/tennisball_toss_wall.mp4 -o $$folder/clip > $$folder/log 2>&1 \
		&& dynamics edit $$folder/clip --set gravity=24.8 -o $$folder/edited >> $$folder/log 2>&1 \
		&& rm -rf $$folder || (cat $$folder/log; exit 1)
	@touch $@

# data/samples, data/measured and data/films are in git; after `rm -rf data` they are restored from there.
repro: install
	@for folder in samples measured films; do test -d data/$$folder || git checkout -q -- data/$$folder || exit 1; done
	@python -m stages.graph.lock_copy
	dvc repro
	@echo "the report: $(CURDIR)/reports/index.html"
	@echo "On another kind of processor the searches end with slightly different scenes, so that git status may show changed reports and dvc.lock."
	@echo "To restore those of the repository: git checkout -- reports dvc.lock"

test: install
	pytest -n 2

# The web pages in Chromium, which has to be on the PATH: the whole way from a clip to an edited one, and what goes wrong.
# Playwright drives it; no browser is downloaded.
test-app: install
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[test,browser]"
	pytest -m app -rs

# What needs Ray and an S3 server (moto's, on this machine), which nothing else does.
test-machines: install
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[test,ray,s3,servers]"
	pytest tests/shards/test_ray_executor.py tests/shards/test_remote.py tests/shards/test_dvc_remote.py tests/shards/test_cluster.py

# Hundreds of kills, thousands of damaged files and inputs (docs/reliability.md); two hours on 2 cores. The default graph on
# a Ray cluster and kills with an S3 server are part of it where those are installed (make test-machines installs them).
campaign: install
	DYNAMICS_CAMPAIGN=full pytest -m campaign -s

check: install
	ruff check .
	ruff format --check .
	mypy

install-benchmark: install
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[benchmark]"

# Takes hours on 2 cores. It may be stopped at any time; the next run goes on from there.
discovery-benchmark: install-benchmark
	python -m benchmarks.discovery

discovery-benchmark-smoke: install-benchmark
	python -m benchmarks.discovery --smoke

# Published measurements; DYNAMICS_DATA is the folder that contains real_motion.
real-motion: install-benchmark
	python -m benchmarks.real_motion

# Removes what `make repro` makes: all data that is not in git, the report's page, and the store.
clean:
	git clean -fdXq data
	rm -rf reports/index.html .shards
