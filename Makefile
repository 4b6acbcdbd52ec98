# One command each. Every target sets the environment up first, if need be.
#
#   make setup                    .venv with everything, ROS 2 from wheels
#   make setup ROS=system         the same on the ROS 2 that is sourced in this shell
#   make setup PYTHON=python3.12  with another Python (3.11 to 3.13)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# An environment stays with the ROS 2 it was made for until another one is asked for.
ROS ?= $(or $(shell cat $(VENV)/.ros 2>/dev/null),wheels)

PIP := $(BIN)/python -m pip --disable-pip-version-check -qq
INSTALL := $(PIP) install --no-deps --no-build-isolation
PYTHONS := 3.12 3.13
PEER := build/peer/bin/check-jsonschema

# Where Python may not keep what it compiled, every start of obk compiles all of it anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup demo test test-unit check golden docs pictures site bench bench-loop bench-tool bench-launches bench-simulator bench-looking bench-summary lock audit wheel release clean fuzz soak soak-short
.DELETE_ON_ERROR:

setup: $(VENV)/.interfaces

demo: setup
	$(BIN)/python examples/dummy/demo.py

test: setup
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist loadfile --durations 20

test-unit: setup
	$(BIN)/python -m pytest -m "not ros and not mujoco"

check: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m pytest --quiet tests/test_architecture.py

# Rewrites the expected outputs of the tests; look at the difference before committing it.
golden: setup
	$(BIN)/python -m pytest tests/golden tests/cases --update-golden

# Writes the pages of rules, commands, keys, messages and classes, the examples of `obk explain`,
# and the pictures that need no running stack.
docs: setup
	$(BIN)/python tools/rule_pages.py
	$(BIN)/python tools/reference_pages.py
	$(BIN)/python tools/pictures.py

# The pictures of a running stack as well; on a machine with nothing else to do.
pictures: docs
	$(BIN)/python tools/pictures.py --live

# The documents as pages to read without a network. A dead link ends it, and so does a page that
# would load something from elsewhere.
site:
	$(PYTHON) -m venv build/site-environment
	build/site-environment/bin/python -m pip --disable-pip-version-check -qq install "$$($(PYTHON) -c \
		'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"])')"
	NO_MKDOCS_2_WARNING=1 build/site-environment/bin/mkdocs build --quiet --clean
	! grep -rnE '(src|<link[^>]* href)="?https?://' build/site --include='*.html'
	@echo "site: build/site/index.html; with search: $(PYTHON) -m http.server --directory build/site"

# What has to be measured on a quiet machine, one after another; says first how long it takes.
#
#   make bench GO_ON=1              what was interrupted goes on
#   make bench PARTS="loop tool"    some of it
#   make bench QUICK=1              whether the loop's suite runs, in a minute
ifdef QUICK
bench: setup
	$(BIN)/python -m benchmarks.loop --quick
else
bench: setup $(PEER)
	$(BIN)/python -m benchmarks $(if $(GO_ON),--go-on) $(if $(PARTS),--parts $(PARTS))
endif

# One part and its whole: more rounds than in `make bench`, an hour of the simulator's time.
bench-loop: setup
	$(BIN)/python -m benchmarks.loop

bench-tool: setup $(PEER)
	$(BIN)/python -m benchmarks.tool $(PEER)

bench-launches: setup
	$(BIN)/python -m benchmarks.launches

bench-simulator: setup
	$(BIN)/python -m benchmarks.simulator

bench-looking: setup
	$(BIN)/python -m benchmarks.looking
	$(BIN)/python -m benchmarks.watched

# Holds the results that are there against their goals; writes benchmarks/results/goals.md.
bench-summary: setup
	$(BIN)/python -m benchmarks.summary

# What `obk validate` is held against.
$(PEER):
	$(PYTHON) -m venv build/peer
	build/peer/bin/python -m pip -qq install check-jsonschema==0.39.0

# Hostile input for SECONDS in all, see tests/fuzz; writes benchmarks/results/fuzz.json.
fuzz: SECONDS ?= 60
fuzz: setup
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS)

# The dummy stack in trouble for SECONDS, then 1,000 rounds of its life cycle in one process; writes
# soak.json, soak.svg, rounds.json and rounds.svg into benchmarks/results.
soak: SECONDS ?= 1800
soak: setup
	$(BIN)/python -m benchmarks.soak --seconds $(SECONDS)
	$(BIN)/python -m benchmarks.soak.rounds

# The same in 3 min, on machines that others keep busy too; the results stay in build/soak.
soak-short: setup
	$(BIN)/python -m benchmarks.soak --seconds 180 --hang-after 5 --least-mb 10 --results build/soak
	$(BIN)/python -m benchmarks.soak.rounds --rounds 100 --results build/soak

# --- the environment, in four steps; each is done again only when what it is made from changes ---

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

# Builds what is released, sdist and wheel of both, and uses it in empty environments of these Pythons.
WHEEL_PYTHONS ?= $(PYTHON)

wheel: setup
	rm -rf dist
	$(BIN)/python -m hatchling build --target sdist --directory dist
	cd interfaces && ../$(BIN)/python -m hatchling build --target sdist --directory ../dist
	$(PIP) wheel --no-deps --no-build-isolation --wheel-dir dist dist/obelisk_cli-*.tar.gz
	for python in $(WHEEL_PYTHONS); do \
		$$python tools/try_release.py dist $(VENV)/requirements.txt || exit 1; \
	done

# Resolved for the oldest Python, so that one version of each package fits all; then checked
# that the newer ones need nothing else.
lock: setup
	$(BIN)/uv pip compile pyproject.toml --quiet --upgrade --python-version 3.11 \
		$(foreach extra,sim viewer render graph monitor web ros-wheels plot dev,--extra $(extra)) \
		--no-annotate --no-header --no-emit-index-url --no-emit-find-links --output-file requirements.lock
	for version in $(PYTHONS); do \
		$(BIN)/uv pip compile requirements.lock --quiet --python-version $$version --no-annotate \
			--no-header --no-emit-index-url --no-emit-find-links | diff requirements.lock - || exit 1; \
	done

# Whether vulnerabilities are known of what is locked; asks a service outside, and fails without it.
audit:
	$(PYTHON) -m venv build/audit
	build/audit/bin/python -m pip --disable-pip-version-check -qq install pip-audit
	build/audit/bin/pip-audit --requirement requirements.lock --no-deps --disable-pip --strict

# Puts the version where it stands, `make release VERSION=0.2.0`, and closes the changelog's part.
release:
	$(PYTHON) tools/release.py $(VERSION)

clean:
	rm -rf $(VENV) build dist interfaces/build .mypy_cache .pytest_cache .ruff_cache .hypothesis
