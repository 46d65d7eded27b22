# A fresh clone needs Python 3.11 or newer and make, nothing else: the targets set .venv up themselves.

DEMO_SECONDS ?= 60

BIN := .venv/bin
PIP := $(BIN)/pip --disable-pip-version-check
COMPARE := $(BIN)/gameopt-sumo compare

.PHONY: help demo two-junctions test test-web lint explore bench growth load figures any-junction compare compare-full

help:
	@echo "make demo     manager and vehicles as two processes, 6,000 veh/h, DEMO_SECONDS=$(DEMO_SECONDS) simulated seconds"
	@echo "make two-junctions  two managers on one Zenoh network, vehicles that pass both junctions; a minute"
	@echo "make test     every test"
	@echo "make test-web the live page in a real browser, which it installs where there is none"
	@echo "make lint     ruff, mypy, import-linter"
	@echo "make explore  the property tests on new random cases, many more of them"
	@echo "make bench    how long decisions take, on recorded and on made-up traffic, then make load; half an hour"
	@echo "make growth   how decisions grow from 50 to 1,000 vehicles on a junction of 48 lanes; five minutes; out/growth"
	@echo "make load     the live service at 60, 130 and 260 vehicles against its targets; 20 minutes; out/load/load.md"
	@echo "make figures  the measured tables of docs/results; takes hours"
	@echo "make compare  every method on the same arrivals, two flows, one seed; four minutes; out/compare/report.md"
	@echo "make compare-full  all experiments of the paper, three seeds; takes hours, and goes on where it was"
	@echo "make any-junction  other junctions against their own control; half an hour"

demo: .venv/installed
	@$(BIN)/python deploy/demo.py --seconds $(DEMO_SECONDS)

two-junctions: .venv/installed
	@$(BIN)/python deploy/two_junctions.py

test: .venv/installed-dev
	$(BIN)/pytest -n 2 --dist loadgroup

test-web: .venv/installed-web
	$(BIN)/pytest tests/web

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

explore: .venv/installed-dev
	$(BIN)/pytest tests/property tests/unit --hypothesis-profile=explore

bench: .venv/installed-dev
	$(BIN)/python tests/load/bench.py
	$(BIN)/python tests/load/live.py

growth: .venv/installed
	$(BIN)/python tests/load/growth.py

load: .venv/installed-dev
	$(BIN)/python tests/load/live.py

any-junction: .venv/installed
	$(BIN)/python tests/load/any_junction.py

compare: .venv/installed
	$(COMPARE) --methods coop,coop@box,coop-paper,coop-fifo,coop-v1,fixed,actuated,stop-sign,all-way-stop \
		--flows 4000,10000 --seeds 1 --duration 120 --warmup 30 --tuning-budget 40 --jobs 2 --out out/compare

# Ends with the worst that any experiment ended with; computation comes last and alone, for its times.
compare-full: .venv/installed-dev
	@worst=0; for experiment in flows unbalanced preferences ablation drift computation; do \
		$(COMPARE) --experiment $$experiment --out out/compare-full; code=$$?; \
		case $$code in 0|1|4) ;; *) exit $$code;; esac; \
		[ $$code -le $$worst ] || worst=$$code; \
	done; \
	$(COMPARE) --experiment flows --methods coop,coop-paper,fixed,actuated,stop-sign --ignore-turn-speed \
		--out out/compare-full-turning; \
	code=$$?; [ $$code -le $$worst ] || worst=$$code; exit $$worst

figures: .venv/installed
	$(BIN)/python tests/load/sweep.py

# SUMO's wheels leave a few libraries to the system; a server without a display may lack them.
SUMO_LOADS = $(BIN)/python -c 'import libsumo' 2>/dev/null || { \
	echo "make: SUMO lacks a system library (Debian, Ubuntu: apt install" \
		"libatomic1 libgl1 libx11-6 libxext6 libxrender1)" >&2; exit 1; }

# The stamps: what is installed follows pyproject.toml.
.venv/installed: pyproject.toml | .venv/bin/pip
	$(PIP) install --editable .
	@$(SUMO_LOADS)
	@touch $@

.venv/installed-dev: pyproject.toml | .venv/bin/pip
	$(PIP) install --editable '.[dev]'
	@$(SUMO_LOADS)
	@touch .venv/installed $@

.venv/installed-web: pyproject.toml .venv/installed-dev
	$(PIP) install --editable '.[dev,web]'
	$(BIN)/python tests/web/browser.py
	@touch $@

# The first Python on PATH that is new enough and can make a virtual environment.
.venv/bin/pip:
	@for python in python3 python3.14 python3.13 python3.12 python3.11 python; do \
		$$python -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
			&& echo "$$python -m venv .venv" && exec $$python -m venv .venv; \
	done; \
	echo "make: needs Python 3.11 or newer with venv on PATH (Debian, Ubuntu: apt install python3-venv)" >&2; \
	exit 1
