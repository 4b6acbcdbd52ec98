# Development commands. Every target sets up the environment first if necessary.
#
#   make setup                    .venv with everything, ROS 2 from wheels
#   make setup ROS=system         the same, with the ROS 2 sourced in this shell
#   make setup PYTHON=python3.12  with another Python (3.11 to 3.13)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# An environment keeps the ROS 2 it was created with until you request another one.
ROS ?= $(or $(shell cat $(VENV)/.ros 2>/dev/null),wheels)

PIP := $(BIN)/python -m pip --disable-pip-version-check -qq
INSTALL := $(PIP) install --no-deps --no-build-isolation
PYTHONS := 3.12 3.13
PEER := build/peer/bin/check-jsonschema

# Without bytecode files, obk would compile all of its modules at every start.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo test test-unit test-slow check golden docs bench clean
.PHONY: lock audit wheel release
.PHONY: $(addprefix docs-,pages pictures site)
.PHONY: $(addprefix bench-,all loop tool launches simulator looking lockstep lockstep-truth summary soak soak-short fuzz)
.DELETE_ON_ERROR:

setup: $(VENV)/.interfaces

define HELP
make setup       create .venv with everything; ROS=system, PYTHON=python3.12
make demo        run the dummy stack for 20 s
make test        run all tests except slow ones, then the closed-loop tests of the examples
make test-unit   run the tests that start no ROS nodes, no simulator and no browser
make test-slow   run the soak, tutorials, colcon builds, all generated packages, many random cases,
                   and the closed-loop tests of the examples with five seeds
make check       run ruff and mypy, and check the imports between packages
make golden      rewrite the expected outputs of the tests
make docs        rewrite the generated pages and pictures
                   PART=pictures  also pictures of a running stack; PART=site  offline HTML pages
make bench       run the benchmarks that have a goal, except lockstep-truth;
                   GO_ON=1, PARTS="loop tool", QUICK=1
                   PART=loop|tool|launches|simulator|looking|lockstep|lockstep-truth|summary  one in full
                   PART=soak|soak-short|fuzz                          SECONDS=60
make clean       remove the environment and all build output

Maintenance: make lock | audit | wheel | release VERSION=0.2.0
endef
export HELP

help:
	@echo "$$HELP"

demo: setup
	$(BIN)/python examples/dummy/demo.py

# ROS tests spend most of their time waiting, so there are two workers for each of two cores. If a worker
# crashes, the run fails immediately; otherwise the other workers would wait for its tests forever.
WORKERS ?= 4
PYTEST := $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile --max-worker-restart 0 \
	--durations 20

# The examples run separately, because simulated time must be set up before any node is imported.
CLOSED_LOOP := $(PYTEST) -p obk_testing.plugin examples/*/tests

test: setup
	$(PYTEST) -m "not slow"
	$(CLOSED_LOOP)

# These tests are CPU-bound. Work stealing keeps all workers busy when one has a long file.
test-unit: setup
	$(BIN)/python -m pytest --numprocesses 3 --dist worksteal --durations 20 \
		-m "not slow and not ros and not mujoco and not browser" --ignore tests/golden

test-slow: setup
	$(PYTEST) -m slow
	$(CLOSED_LOOP) --seeds 5
	$(PYTEST) --hypothesis-profile full tests/property

check: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m pytest --quiet tests/test_architecture.py

# Rewrites the expected outputs and transcripts of the tests; review the diff before you commit it.
golden: setup
	$(BIN)/python -m pytest tests/golden tests/cases --update-golden

docs: docs-$(or $(PART),pages)

# Rewrites the pages of rules, commands, keys, messages and classes, the examples of `obk explain`,
# and the pictures that do not need a running stack.
docs-pages: setup
	$(BIN)/python tools/rule_pages.py
	$(BIN)/python tools/reference_pages.py
	$(BIN)/python tools/pictures.py

# Run this on an idle machine.
docs-pictures: docs-pages
	$(BIN)/python tools/pictures.py --live

# Builds the documentation as offline HTML pages. Fails if a link is dead, or if a page would load
# anything from the network.
docs-site:
	$(PYTHON) -m venv build/site-environment
	build/site-environment/bin/python -m pip --disable-pip-version-check -qq install "$$($(PYTHON) -c \
		'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"])')"
	NO_MKDOCS_2_WARNING=1 build/site-environment/bin/mkdocs build --quiet --clean
	! grep -rnE '(src|<link[^>]* href)="?https?://' build/site --include='*.html'
	@echo "site: build/site/index.html; with search: $(PYTHON) -m http.server --directory build/site"

bench: bench-$(or $(PART),all)

# Runs all benchmarks one after another; first prints how long they take. Needs an idle machine.
ifdef QUICK
bench-all: setup
	$(BIN)/python -m benchmarks.loop --quick
else
bench-all: setup $(PEER)
	$(BIN)/python -m benchmarks $(if $(GO_ON),--go-on) $(if $(PARTS),--parts $(PARTS))
endif

# Runs one part in full: more rounds than in `make bench`, and an hour of simulated time.
bench-loop bench-launches bench-simulator bench-lockstep: bench-%: setup
	$(BIN)/python -m benchmarks.$*

bench-tool: setup $(PEER)
	$(BIN)/python -m benchmarks.tool $(PEER)

bench-looking: setup
	$(BIN)/python -m benchmarks.looking
	$(BIN)/python -m benchmarks.watched

# Compares real runs of the quadruped with lockstep runs.
bench-lockstep-truth: setup
	$(BIN)/python -m benchmarks.lockstep_truth
	cp benchmarks/results/lockstep_truth.svg docs/pictures

# Compares existing results with their goals; writes benchmarks/results/goals.md.
bench-summary: setup
	$(BIN)/python -m benchmarks.summary

# The program that `obk validate` is compared with.
$(PEER):
	$(PYTHON) -m venv build/peer
	build/peer/bin/python -m pip -qq install check-jsonschema==0.39.0

# Injects faults into the dummy stack for SECONDS, then repeats the lifecycle 1,000 times in one process.
bench-soak: SECONDS ?= 1800
bench-soak: setup
	$(BIN)/python -m benchmarks.soak --seconds $(SECONDS)
	$(BIN)/python -m benchmarks.soak.rounds

# Injects each fault at least once; works on a busy machine. The results stay in build/soak.
bench-soak-short: SECONDS ?= 60
bench-soak-short: setup
	$(BIN)/python -m benchmarks.soak --seconds $(SECONDS) --hang-after 5 --least-mb 10 --results build/soak
	$(BIN)/python -m benchmarks.soak.rounds --rounds 50 --results build/soak

# Feeds hostile input for SECONDS in total, see tests/fuzz; writes build/benchmarks/fuzz.json.
bench-fuzz: SECONDS ?= 60
bench-fuzz: setup
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS)

# --- the environment, in four steps; each step is repeated only if its inputs change ---

ifneq ($(ROS),$(shell cat $(VENV)/.ros 2>/dev/null))
.PHONY: $(VENV)/.ros
endif

$(VENV)/.ros:
	@$(PYTHON) tools/preflight.py $(ROS)
	@echo "setup: new environment in $(VENV), ROS 2 from $(ROS)"
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV)
	@echo $(ROS) > $@

$(VENV)/requirements.txt: requirements.lock $(VENV)/.ros
	@echo "setup: packages of requirements.lock"
ifeq ($(ROS),system)
	@grep -v '^ros-' requirements.lock > $@
else
	@cp requirements.lock $@
endif
	@$(PIP) install --no-deps -r $@

$(VENV)/.project: pyproject.toml hatch_build.py $(shell find ros_packages -type f) $(VENV)/requirements.txt
	@echo "setup: obelisk-cli (editable)"
	@$(INSTALL) --editable .
	@touch $@

$(VENV)/.interfaces: $(shell find interfaces -type f -not -path 'interfaces/build/*' -not -name '*.pyc') \
		$(wildcard src/obk_interfaces/*.py) $(VENV)/.project
	@echo "setup: obelisk-interfaces (compiles the message packages)"
	@$(INSTALL) --force-reinstall ./interfaces
	@touch $@

# --- maintenance ---

# Builds sdists and wheels of both distributions, and tries them in empty environments of these Pythons.
WHEEL_PYTHONS ?= $(PYTHON)

wheel: setup
	rm -rf dist
	$(BIN)/python -m hatchling build --target sdist --directory dist
	cd interfaces && ../$(BIN)/python -m hatchling build --target sdist --directory ../dist
	$(PIP) wheel --no-deps --no-build-isolation --wheel-dir dist dist/obelisk_cli-*.tar.gz
	for python in $(WHEEL_PYTHONS); do \
		$$python tools/try_release.py dist $(VENV)/requirements.txt || exit 1; \
	done

# Resolves for the oldest Python, so that one version of each package works for all; then checks
# that newer Pythons resolve to the same versions.
lock: setup
	$(BIN)/uv pip compile pyproject.toml --quiet --upgrade --python-version 3.11 \
		$(foreach extra,sim viewer render graph monitor web ros-wheels plot export sweep policy dev,--extra $(extra)) \
		--no-annotate --no-header --no-emit-index-url --no-emit-find-links --output-file requirements.lock
	for version in $(PYTHONS); do \
		$(BIN)/uv pip compile requirements.lock --quiet --python-version $$version --no-annotate \
			--no-header --no-emit-index-url --no-emit-find-links | diff requirements.lock - || exit 1; \
	done

# Checks the locked packages for known vulnerabilities; needs access to an online service.
audit:
	$(PYTHON) -m venv build/audit
	build/audit/bin/python -m pip --disable-pip-version-check -qq install pip-audit
	build/audit/bin/pip-audit --requirement requirements.lock --no-deps --disable-pip --strict

# Sets the version in all files, `make release VERSION=0.2.0`, and dates the changelog section.
release:
	$(PYTHON) tools/release.py $(VERSION)

clean:
	rm -rf $(VENV) build dist interfaces/build .mypy_cache .pytest_cache .ruff_cache .hypothesis
