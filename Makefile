PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WHOLE := $(VENV)/installed
SMALL := $(VENV)/installed-for-report
CORE := $(VENV)/installed-for-core
PLAYED := $(VENV)/installed-for-play
EXTRAS := train report play data robot render zoo objectives cluster docs test dev
PINS := -c constraints.txt  # PINS= takes the newest version of each package
SETUPS_OF_RESULTS := linear-blind linear-ranged bistable-blind paper-limits linear-sensed linear-robust ranged-robust \
	linear-wide teleop-rigid teleop-spring teleop-bistable teleop-hurried
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help report results play test core setup lint docs coverage mutants

help:  ## list what can be made
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "make %-9s %s\n", $$1, $$2}'

SOLVER := pyproject.toml constraints.txt setup.py $(wildcard impact_gym/*.pyx impact_gym/*/*.pxi impact_gym/*/*.h) \
	impact_gym/quantities.py impact_gym/solver/tableau.py impact_gym/task/numbers.py

PIP = $(BIN)/pip install --quiet --no-compile --disable-pip-version-check $(PINS)
COMPILE := --no-build-isolation --no-deps -e .  # when it fails, again and with what the compiler says
WANTED := import sys, tomllib; read = tomllib.load(open("pyproject.toml", "rb")); project = read["project"]; \
	lists = map((project["optional-dependencies"] | read["dependency-groups"]).get, sys.argv[1:]); \
	print(*project["dependencies"], *sum(lists, []), sep="\n")

define install
@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	|| { echo "Python 3.11 or newer is needed; name one with make PYTHON=..."; exit 1; }
@$(PYTHON) -m venv $(VENV)
@echo "1 of 2: installing what compiles the solver into $(VENV)"
@$(PIP) cython setuptools numpy scipy
@echo "2 of 2: compiling the solver (about 15 s) and, beside it, installing $(2)"
@{ $(PIP) $(COMPILE) || $(BIN)/pip install $(COMPILE); } & $(BIN)/python -c '$(WANTED)' $(1) > $(VENV)/wanted.txt \
	&& $(PIP) -r $(VENV)/wanted.txt && wait $$!
@$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true  # on all cores, where pip takes one
endef

report: $(SMALL)  ## compare the policies and baselines of four set-ups, or of SETUPS="...", in reports/latest/index.html
	$(BIN)/impact-gym report $(SETUPS) $(if $(FORCE),--force)

# on two cores: paper 10 s, speed 50 min, stability 10 min, teleop 5 min, sensors 1 h, engines 20 min, report 15 min, stock 3 h
results: setup  ## make docs/results and the numbers on pages again, in about 6 h on two cores; repeat it to continue
	$(PIP) mujoco newton drake sapien pybullet rapier3d  # the extra engines
	@set -- "study paper" "study speed" "study stability" "study teleop" "study sensors" "study engines" "report $(SETUPS_OF_RESULTS)" "study stock"; \
	for each; do shift; begun=$$(date +%s); echo "impact-gym $$each --results docs/results"; \
		$(BIN)/impact-gym $$each --results docs/results || exit; \
		echo "took $$(( ($$(date +%s) - begun) / 60 )) min"; [ $$# = 0 ] || printf "left: impact-gym %s\n" "$$@"; done
	cp reports/latest/figures/linear-blind_answer.svg docs/trade_off.svg
	$(BIN)/python docs/generated.py

play: $(PLAYED)  ## steer the tool in the browser, SETUP=teleop-spring ASSIST=none
	$(BIN)/impact-gym play $(SETUP) $(if $(ASSIST),--assist $(ASSIST))

test: setup  ## run the tests; OPTIONS="-m slow" runs the slow ones
	@echo 'Slow tests run at night; here: make test OPTIONS="-m slow"'
	$(PYTEST) $(OPTIONS)

core: $(CORE)  ## run the tests that need no extra, and install only what they need
	$(PYTEST) tests/physics tests/task tests/robot tests/test_simulation.py tests/solver

setup: $(WHOLE)  ## make .venv and install everything that is pinned

lint: setup  ## format check, lint, types, import order
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: setup  ## build the documentation as a site that needs no network, site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

coverage: setup  ## run the tests and list the lines that none of them runs in its own process
	$(PYTEST) --cov

mutants: setup  ## edit a PART of the code, one place at a time, and list the edits that TESTS do not notice
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.mutants $(if $(PART),--part $(PART)) $(if $(TESTS),--tests "$(TESTS)") $(if $(SEED),--seed $(SEED))

$(WHOLE): $(SOLVER)
	$(call install,$(EXTRAS),everything; torch is large: this can take minutes)
	@touch $(SMALL) $(PLAYED) $(CORE) $@

$(SMALL): $(SOLVER)
	$(call install,report,what a report needs)
	@touch $@

$(CORE): $(SOLVER)
	$(call install,test,what the tests of the core need)
	@touch $@

$(PLAYED): $(SOLVER)
	$(call install,play,what the page to play on needs)
	@touch $@
