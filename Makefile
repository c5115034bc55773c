# `make help` lists the targets; each does its own set-up. PYTHON=3.12 runs a target on that
# version, in an environment of its own (.venv-3.12).
SHELL := /bin/sh
export EOL_VENV := .venv$(patsubst %,-%,$(filter 3.%,$(PYTHON)))
PY := $(EOL_VENV)/bin/python
SCENE ?= rehearsal
.DEFAULT_GOAL := help

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 18

setup:  ## .venv with everything that a run needs
	@tools/setup_env.sh

run: setup  ## bring a scene to life (SCENE=rehearsal); Ctrl-C stops it
	@$(PY) -m eol_ros.bringup $(SCENE) $(ARGS)

test: setup-test  ## all tests, with real DDS, pty, PortAudio and Chromium where they are
	@$(PY) tools/run_tests.py $(ARGS)

bare: setup-test  ## tests of devices, pages and scenes, the optional system packages hidden
	@$(PY) tools/run_tests.py --bare $(ARGS)

quick: setup-core  ## the tests of the pure core, in seconds
	@$(PY) tools/run_tests.py --quick $(ARGS)

lint: setup-test  ## ruff, mypy and the terms that are not used
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) tools/check_words.py

docs: setup-test  ## rewrite the generated pages, and build the site in build/docs
	$(PY) tools/generate_docs.py
	$(PY) -m sphinx -q -W --keep-going -b html docs build/docs
	@$(PY) -m assets.sheet
	@echo build/docs/index.html

kit: setup-test  ## draw schematics, tables and drawings of docs/build again
	$(PY) -m assets.kit

firmware: setup-test  ## build what runs in the blocks, and test it in emulated controllers
	@tools/system_packages.sh firmware
	$(MAKE) -s -C firmware all emulator
	$(PY) -m pytest -m 'firmware and not soak' test/firmware $(ARGS)

soak: setup-test  ## the long ones: hours of rehearsal, kills, floods, fuzzing
	@tools/system_packages.sh firmware
	$(PY) -m pip install -q uv
	-$(PY) -m pip install -q atheris
	$(PY) -m pytest -m soak --override-ini addopts= test

bench: setup-test  ## the graph's figures
	$(PY) -m eol_ros bench graph

lock:  ## renew the versions and hashes of all wheels (ARGS=--upgrade: the newest)
	@tools/lock_requirements.sh $(ARGS)

film: setup-test  ## the film that the README opens with, and its sound (needs Chromium)
	$(PY) -m assets.film $(ARGS)

screens: setup-test  ## every page at every size, in both languages and six states (needs Chromium)
	$(PY) -m assets.screens $(ARGS)

films: setup-test  ## path-trace printed covers for `eol bench vision --films films` (needs LLVM 19)
	$(PY) -m pip install -q 'mitsuba>=3.9'
	$(PY) -m assets.relief --output films $(ARGS)

clean:  ## remove what was made here, but no bag
	rm -rf .venv .venv-3.* build install log *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

setup-test:
	@tools/setup_env.sh test

setup-core:
	@tools/setup_env.sh core

.PHONY: help setup setup-test setup-core run test bare quick lint docs kit firmware soak bench lock film films screens clean
