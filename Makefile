PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
WHOLE := $(VENV)/installed
SMALL := $(VENV)/installed-for-report
PLAYED := $(VENV)/installed-for-play
EXTRAS := train report play data identify robot render zoo objectives peers cluster docs dev

.DEFAULT_GOAL := help
.PHONY: help setup report play test coverage mutants train train-all controller tune gain figures bench speed stability docs publish identify \
	design lint

help:  ## list what can be made
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "make %-9s %s\n", $$1, $$2}'

SOLVER := pyproject.toml constraints.txt setup.py $(wildcard impact_gym/*.pyx impact_gym/*/*.pxi impact_gym/*/*.h)

PIP = $(BIN)/pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt
WANTED := import sys, tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
	lists = map(project["optional-dependencies"].get, sys.argv[1:]); \
	print(*project["dependencies"], *sum(lists, []), sep="\n")

define install
@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	|| { echo "Python 3.11 or newer is needed; name one with make PYTHON=..."; exit 1; }
@$(PYTHON) -m venv $(VENV)
@echo "1 of 2: installing what compiles the solver into $(VENV)"
@$(PIP) cython setuptools
@echo "2 of 2: compiling the solver (about 15 s) and, beside it, installing $(2)"
@$(PIP) --no-build-isolation --no-deps -e . & $(BIN)/python -c '$(WANTED)' $(1) > $(VENV)/wanted.txt \
	&& $(PIP) -r $(VENV)/wanted.txt && wait $$!
@$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true  # on all cores, where pip takes one
endef

setup: $(WHOLE)  ## make .venv and install everything that is pinned

$(WHOLE): $(SOLVER)
	$(call install,$(EXTRAS),everything; torch is large: this can take minutes)
	@touch $(SMALL) $(PLAYED) $@

$(SMALL): $(SOLVER)
	$(call install,report,what a report needs)
	@touch $@

$(PLAYED): $(SOLVER)
	$(call install,play,what the page to play on needs)
	@touch $@

play: $(PLAYED)  ## take the stick: steer the tool in the browser, SETUP=teleop-spring ASSIST=none
	$(BIN)/impact-gym play $(SETUP) $(if $(ASSIST),--assist $(ASSIST))

report: $(SMALL)  ## play policies and baselines of four set-ups, or of SETUPS="...", write reports/latest/index.html; FORCE=1: all anew
	$(BIN)/impact-gym report $(SETUPS) $(if $(FORCE),--force)

test: setup  ## run the tests, OPTIONS='-m "not storm"' without the long ones
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadscope $(OPTIONS)  # a core for each worker

coverage: setup  ## run the tests and say which lines none of them runs in its own process
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadscope --cov

mutants: setup  ## edit hundreds of lines, one at a time, and see which edits no test notices; an hour
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.mutants

train: setup  ## train a policy with default settings; prints its run folder
	$(BIN)/impact-gym train

train-all: setup  ## train ten seeds of four set-ups and ship the medians; goes on where it was stopped
	$(BIN)/impact-gym train-seeds

tune: setup  ## tune the baselines and search who knows the object; goes on where it was stopped
	$(BIN)/impact-gym tune --bound

controller: setup  ## tune, train, report and export for SETUP=my.toml into OUT=runs/NAME; QUICK=1 for a first look
	$(BIN)/impact-gym controller $(SETUP) --out $(or $(OUT),runs/$(basename $(notdir $(SETUP)))$(if $(QUICK),-quick)) $(if $(QUICK),--quick)

design: setup  ## which coupling with its best controller: FREE="coupling.stiffness=10:300 ..." SETUP=my.toml OUT=DIR
	$(BIN)/impact-gym design $(SETUP) --free $(FREE) --out $(OUT)

gain: setup  ## say what the gain over the paper's rule is made of, below reports/gain
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/impact-gym gain

figures: setup  ## reproduce figures of the paper below reports/paper
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/impact-gym paper  # its matrices are too small for more

bench: setup  ## measure speed against SciPy and Gymnasium in one run, and what simpler models save
	$(BIN)/impact-gym bench

speed: setup  ## speed against error, ours beside others, below reports/speed
	$(BIN)/impact-gym speed

stability: setup  ## a storm of random scenes through the solver, its checks and rivals, below reports/stability
	$(BIN)/impact-gym stability

docs: setup  ## build the documentation as a site that needs no network, site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

publish: setup  ## keep the site of VERSION=dev, or VERSION="0.1 latest", beside the others on the branch gh-pages
	DOCS_VERSIONS=mike NO_MKDOCS_2_WARNING=1 PATH=$(BIN):$$PATH $(BIN)/mike deploy --update-aliases $(VERSION)

identify: setup  ## fit logs of the independent solver, intervals and errors beside the bound, below reports/identify
	$(BIN)/impact-gym fits

lint: setup  ## format check, lint, types, import order
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
