# make demo: install, plan the four cases of the paper, carry the third out in MuJoCo; tables, pictures, film in demo/
# make test: install what the tests need, then lint, types and tests
#   with the newest of everything:         make test PYTHON=python3.13 VENV=.venv-newest CONSTRAINTS=
#   with the oldest versions allowed:      make unit PYTHON=python3.11 VENV=.venv-oldest CONSTRAINTS=oldest.txt
PYTHON ?= python3
VENV ?= .venv
CONSTRAINTS ?= constraints.txt
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check $(addprefix --constraint ,$(CONSTRAINTS))
# The newest MuJoCo is too new for dm-control.
comma := ,
EXTRAS := agents,data,dev,study,viewer$(if $(CONSTRAINTS),$(comma)dm)

.PHONY: demo test lint types unit short test-docs slow browser coverage results compare docs release clean

demo: $(VENV)/.core
	@echo "Plans the four cases of the paper's Table I in three modes, and carries the third out in MuJoCo:"
	@echo "about 2 minutes, 1 more where the kernels are compiled first. All files go to demo/."
	@$(BIN)/mlivr-gym table1 --out demo
	@$(BIN)/mlivr-gym simulate --case 3 --out demo/walk > demo/walk.txt || { cat demo/walk.txt; exit 1; }
	@grep "steps executed" demo/walk.txt
	@echo "Look at demo/case3_collisions.png (the plan), demo/walk/walk.gif (the walk in MuJoCo),"
	@echo "demo/walk/simulation.png (torques, forces), demo/table1.md (all figures), demo/walk.txt (each step)."

# Types are checked beside the tests, which saves the time of a core that would wait.
test: lint
	@$(MAKE) --no-print-directory --jobs 2 types unit

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell

types: $(VENV)/.dev
	$(BIN)/mypy

# As many workers as cores and memory allow (tests/support/machine.py); tests of one file stay together, since they share what they set up.
unit: $(VENV)/.dev
	$(BIN)/pytest --numprocesses auto --dist loadfile

# Planner, environment, simulation and files, with what these tests need alone: under five minutes.
SHORT := $(addprefix tests/,planners/test_planner.py envs/test_env.py simulation/test_simulator.py \
  motion/test_plan_files.py test_files.py test_arguments.py cli/test_doctor.py)

short: $(VENV)/.short
	$(BIN)/pytest --numprocesses auto --dist loadfile $(SHORT)

# Runs every command and snippet of README, site and examples, and the tests in a browser; says what was skipped and why.
test-docs: $(VENV)/.dev browser
	$(BIN)/pytest --numprocesses auto --dist loadgroup -m docs -rs

# The tests that `make test` leaves out because each takes minutes.
slow: $(VENV)/.dev
	$(BIN)/pytest --numprocesses auto -m slow

# The viewer in a headless Chromium of the system (Debian: chromium); skipped with a reason where there is none.
browser: $(VENV)/.dev $(VENV)/.docs
	$(BIN)/pytest -m browser -rs

# Lines that no test runs, kernels apart: at least 93 % are run.
coverage: $(VENV)/.dev
	$(BIN)/pytest --numprocesses auto --dist loadfile --cov --cov-fail-under 93

# Everything published under results/ but the comparison; takes two to three hours.
results: $(VENV)/.dev
	$(BIN)/python experiments/calibrate_start_goal.py
	$(BIN)/mlivr-gym table1 --out results
	$(BIN)/python experiments/table1_study.py
	$(BIN)/python experiments/table1_statistics.py
	$(BIN)/python experiments/truth.py
	$(BIN)/python experiments/benchmark_planning.py
	$(BIN)/python experiments/dynamic_simulation.py
	$(BIN)/python experiments/disturbances.py
	$(BIN)/python experiments/closed_loop.py
	$(BIN)/python experiments/closed_loop_policies.py
	$(BIN)/python experiments/station_load.py
	$(BIN)/python experiments/reaction.py
	$(BIN)/python experiments/cargo_mission.py
	$(BIN)/python experiments/failed_joints.py
	$(BIN)/python experiments/robots.py
	$(BIN)/python experiments/films.py
	$(BIN)/mlivr-gym walk --start D2a:4 D2b:4 --goal 6.0 0.0 0.42 --unknown 3.2 -1.0 -1.0 3.4 1.0 0.2 \
	  --unknown 4.7 0.3 0.0 5.0 0.8 0.5 --film results/closed_loop.gif --size 464 288 --speed 12
	$(BIN)/python experiments/overview.py
	$(BIN)/python experiments/concept_figures.py
	$(BIN)/python experiments/concept_labels.py
	$(BIN)/python experiments/notebooks.py
	$(BIN)/python experiments/benchmark_env.py
	$(BIN)/python experiments/places.py
	$(BIN)/python experiments/place_pictures.py
	$(BIN)/python experiments/start_up.py
	$(BIN)/python experiments/readme.py

# Trains all policies and measures everything that acts: three to four hours, without a GPU.
compare: $(VENV)/.dev
	$(BIN)/python experiments/train_policies.py
	$(BIN)/python experiments/planner_vs_rl.py
	$(BIN)/python experiments/unknown_map.py
	$(BIN)/python experiments/readme.py

# The site, in docs/_build/html; a warning is an error.
docs: $(VENV)/.docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs docs/_build/html

# Wheels and sdists, in dist/, with a README whose links work on a package index; see CONTRIBUTING.md.
release: $(VENV)/.core
	$(PIP) build
	$(BIN)/python .ci/release.py --repository $(REPOSITORY)

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { echo "python3 -m venv failed; on Debian: apt install python3-venv"; exit 1; }

# The oldest versions that pyproject.toml allows of what users install.
oldest.txt: pyproject.toml .ci/oldest.py
	@$(PYTHON) .ci/oldest.py > $@

$(VENV)/.core: $(VENV)/bin/python pyproject.toml $(CONSTRAINTS)
	$(PIP) --editable .
	@touch $@

# PyTorch first and pinned, so that nothing else pulls another build of it.
$(VENV)/.dev: $(VENV)/.core
	$(PIP) torch$(if $(CONSTRAINTS),,==2.13.0)
	$(PIP) --editable '.[$(EXTRAS)]'
	@touch $@

$(VENV)/.short: $(VENV)/.core
	$(PIP) hypothesis pytest pytest-xdist
	@touch $@

$(VENV)/.docs: $(VENV)/.core
	$(PIP) --editable '.[docs]'
	@touch $@

clean:
	rm -rf $(VENV) demo build docs/_build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
