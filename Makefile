# Each target installs its requirements; `make demo` and `make test` run on a machine with Python only.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet install -c constraints.txt
DEMO_OUT ?= out/demo
IMAGE ?=
ARGS ?=
# Interpreters for which a release is built and tested; the wheel of 3.12 or later supports all later versions.
RELEASE_PYTHONS ?= $(PYTHON)
# Each Blender wheel supports one Python version: 3.13 for Blender 5.1 to 5.3, 3.11 for 4.5 and 5.0.
BLENDER_PYTHON ?= $(shell command -v python3.13 || echo $(PYTHON))
NATIVE := $(wildcard native/CMakeLists.txt native/src/*.* native/src/*/*)

# Byte code is always written. Without it, each process compiles the package and rewrites the asserts of all tests, which
# takes 15 s of processor time instead of 9 s.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo studio check test test-full test-lowest test-newest test-releases smoke mutation programs chromium firefox node page lint format bench bench-page docs release clean

help:  ## List the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

demo: $(VENV)/.core  ## Evaluate and simulate a sensor, dewarp the image, and write a report
	$(BIN)/omnimirror demo -o $(DEMO_OUT)

studio: $(VENV)/.studio  ## Start the studio: dewarp images and design sensors in the browser
	$(BIN)/omnimirror studio

# A representative subset: all contracts, the structure of the code, and main paths of the packages.
CHECKED := tests/contracts tests/test_architecture.py tests/dewarp/test_dewarper.py tests/dewarp/test_screens.py \
  tests/optics/test_misaligned.py tests/analysis/test_two_mirrors.py tests/design/test_requirement_files.py \
  tests/io/test_orientation.py

check: lint  ## Run lint, type checks and a subset of the tests (about 90 s on 2 cores)
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not full and not long" $(CHECKED)

test: lint chromium node  ## Run the tests that every commit must pass (about 10 minutes on 2 cores)
	$(BIN)/python -m pytest -n auto --dist worksteal -m "not full"

# Tests with dozens of seeds and complete searches exceed the time limit of the everyday tests.
test-full: lint chromium firefox node $(VENV)/.full  ## Run all tests, including long ones and other programs (2.6 GB more, with PyTorch for CPU)
	$(BIN)/python -m pytest -n auto --dist worksteal --timeout 3600 -o faulthandler_timeout=3900 --cross-validation docs/cross-validation.md
	native/sanitize.sh $(BIN)/python -q

# Tests of the packages that all others use, of videos and of object stores. Old versions emit deprecation warnings, which
# are not errors here.
LOWEST_TESTS := tests/contracts tests/base tests/cameras tests/optics tests/analysis tests/dewarp tests/io tests/interop/batch

test-lowest:  ## Smoke test and a third of the tests with the lowest supported versions of the dependencies
	@$(MAKE) smoke VERSIONS=lowest RESOLUTION=lowest-direct EXTRAS='[test]'
	out/lowest/bin/python -m pytest -n auto --dist worksteal -W default -m "not full and not long" $(LOWEST_TESTS)

test-newest:  ## Smoke test with the newest versions of the dependencies
	@$(MAKE) smoke VERSIONS=newest RESOLUTION=highest

smoke: $(BIN)/python
	$(PIP) uv
	$(BIN)/uv venv --quiet --clear --python $(BIN)/python out/$(VERSIONS)
	$(BIN)/uv pip install --quiet --python out/$(VERSIONS)/bin/python --resolution $(RESOLUTION) '.$(EXTRAS)'
	out/$(VERSIONS)/bin/python release/smoke_test.py
	out/$(VERSIONS)/bin/omnimirror simulate paper-spherical --samples 1 -o out/$(VERSIONS)/circle.png
	out/$(VERSIONS)/bin/omnimirror dewarp out/$(VERSIONS)/circle.png --sensor paper-spherical --view panorama -o out/$(VERSIONS)/panorama.png
	out/$(VERSIONS)/bin/omnimirror maps paper-spherical --view panorama -o out/$(VERSIONS)/maps.npz
	out/$(VERSIONS)/bin/omnimirror demo --output out/$(VERSIONS)/demo

test-releases: $(VENV)/.full  ## Comparisons with the oldest and the newest releases of other programs (PROGRAMS="COLMAP FFmpeg")
	$(PIP) uv
	$(BIN)/python tests/program_releases.py $(PROGRAMS)

mutation: $(VENV)/.mutation  ## Run mutation testing: fraction of random code changes that tests detect (ARGS=--help)
	$(BIN)/python tests/mutation.py $(ARGS)

programs: $(BIN)/python  ## Install Blender, Newton, GStreamer, OBS, ... for interoperability tests (2 GB)
	@{ command -v gst-launch-1.0 && command -v cvlc && command -v qemu-system-arm; } >/dev/null || { \
	  [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && \
	  apt-get -qq update && apt-get -qq install -y gstreamer1.0-tools gstreamer1.0-gl gstreamer1.0-plugins-good \
	  gstreamer1.0-python3-plugin-loader python3-gst-1.0 \
	  gir1.2-gst-rtsp-server-1.0 python3-gi vlc-bin vlc-plugin-base \
	  libobs0 libegl1 libgl1-mesa-dri xvfb xauth glslang-tools spirv-cross qemu-system-arm >/dev/null; } || \
	  echo "some programs are not installed: their interoperability tests are skipped"
	@if command -v npm >/dev/null; then \
	  npm install --silent --no-audit --no-fund --prefix $(VENV)/node @micropython/micropython-webassembly-pyscript; fi
	$(PIP) ziglang
	for name in blender-oldest:'bpy==4.5.*' newton:newton; do \
	  $(PYTHON) -m venv $(VENV)/$${name%%:*} && $(VENV)/$${name%%:*}/bin/python -m pip --quiet install "$${name##*:}" || exit 1; \
	done
	$(BLENDER_PYTHON) -m venv $(VENV)/blender && $(VENV)/blender/bin/python -m pip --quiet install bpy

lint: $(VENV)/.test node
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	@! command -v npm >/dev/null || { cd web && npm run --silent lint; }

# Browser for the tests of the studio. The headless shell takes half of the processor time of the complete browser, because
# it draws no window frames.
chromium:
	@command -v chromium-headless-shell >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && \
	  apt-get -qq update && { apt-get -qq install -y chromium-headless-shell || apt-get -qq install -y chromium; } >/dev/null; } || \
	  command -v chromium >/dev/null || command -v google-chrome >/dev/null || \
	  echo "chromium is not installed: the browser tests of the studio are skipped"

# Second browser (270 MB); the everyday tests use it if it is installed.
firefox:
	@command -v firefox-esr >/dev/null || command -v firefox >/dev/null || { [ "$$(id -u)" = 0 ] && \
	  command -v apt-get >/dev/null && apt-get -qq update && apt-get -qq install -y firefox-esr >/dev/null; } || \
	  echo "firefox is not installed: its tests of the studio are skipped"

# Tools for building, linting and testing the page of the studio.
node:
	@if command -v npm >/dev/null; then $(MAKE) -s web/node_modules/.made; else \
	  echo "npm is not installed: the page's linter, formatter, unit tests, build comparison and axe tests are skipped"; fi

web/node_modules/.made: web/package-lock.json
	cd web && npm ci --no-audit --no-fund --loglevel=error
	@touch $@

page: $(VENV)/.test  ## Build the studio's page from web/ (needs Node 20)
	$(BIN)/python web/message_types.py
	cd web && npm ci --no-audit --no-fund && npm run build

format: $(VENV)/.test node  ## Format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	@! command -v npm >/dev/null || { cd web && npm run --silent format; }

bench: $(VENV)/.full  ## Run the benchmarks; write tables to out/benchmarks
	$(BIN)/python benchmarks/evaluation_time.py -o out/benchmarks
	$(BIN)/python benchmarks/rendering_time.py -o out/benchmarks
	$(BIN)/python benchmarks/scene_rate.py -o out/benchmarks
	$(BIN)/python benchmarks/interpolation_quality.py -o out/benchmarks
	$(BIN)/python benchmarks/video_rate.py -o out/benchmarks $(if $(IMAGE),--image $(IMAGE))
	$(BIN)/python benchmarks/live_latency.py -o out/benchmarks $(if $(IMAGE),--image $(IMAGE))
	$(BIN)/python benchmarks/gateway_load.py -o out/benchmarks $(if $(IMAGE),--image $(IMAGE))
	$(BIN)/python benchmarks/misaligned_tables.py -o out/benchmarks
	$(BIN)/python benchmarks/command_time.py -o out/benchmarks
	$(BIN)/python benchmarks/memory.py -o out/benchmarks
	$(BIN)/python benchmarks/stream_load.py -o out/benchmarks
	$(BIN)/python benchmarks/design_rate.py -o out/benchmarks
	$(BIN)/python benchmarks/real_lens_rate.py -o out/benchmarks
	$(BIN)/python benchmarks/catalogue_search.py -o out/benchmarks
	$(BIN)/python benchmarks/feasible_requirements.py --count 300 -o out/benchmarks
	$(BIN)/python benchmarks/tolerance_rate.py -o out/benchmarks
	$(BIN)/python benchmarks/tolerance_comparison.py -o out/benchmarks
	$(BIN)/python benchmarks/tolerance_cluster.py -o out/benchmarks
	$(BIN)/python benchmarks/batch_throughput.py -o out/benchmarks
	$(BIN)/python benchmarks/batch_interruptions.py -o out/benchmarks
	$(BIN)/python benchmarks/slider_latency.py -o out/benchmarks
	$(BIN)/python benchmarks/restoration_gain.py -o out/benchmarks
	$(BIN)/python benchmarks/dewarping_rate.py -o out/benchmarks $(if $(IMAGE),--image $(IMAGE))
	$(BIN)/python benchmarks/moving_views.py -o out/benchmarks $(if $(IMAGE),--image $(IMAGE))
	$(BIN)/python benchmarks/page_load.py -o out/benchmarks
	$(BIN)/python benchmarks/user_tasks.py -o out/benchmarks
	$(BIN)/python benchmarks/first_minutes.py -o out/benchmarks $(if $(DATA),--photographs $(DATA))

bench-page: bench  ## Run the benchmarks and insert the tables into docs/benchmarks.md
	$(BIN)/python benchmarks/update_tables.py --tables out/benchmarks

docs: $(VENV)/.core  ## Build the documentation site in out/site
	$(PYTHON) -m venv out/mkdocs
	out/mkdocs/bin/python -m pip --disable-pip-version-check --quiet install -c constraints.txt -r docs/requirements.txt
	$(PIP) -e '.[studio]'
	$(BIN)/python docs/site_pages.py
	out/mkdocs/bin/mkdocs build --strict

release: | $(BIN)/python  ## Build and test the archive and the wheels; RELEASE_PYTHONS="python3.11 python3.12"
	$(PYTHON) -m venv out/release
	out/release/bin/python -m pip --disable-pip-version-check --quiet install -c constraints.txt -r release/requirements.txt
	out/release/bin/python release/build.py $(foreach p,$(RELEASE_PYTHONS),--python $(p))

clean:  ## Remove build products and the virtual environment
	rm -rf $(VENV) out build web/node_modules dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "omnimirror needs Python 3.11 or newer; $(PYTHON) is older: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.core: pyproject.toml constraints.txt $(NATIVE) | $(BIN)/python
	$(PIP) -e .
	@touch $@

$(VENV)/.studio: pyproject.toml constraints.txt $(NATIVE) | $(BIN)/python
	$(PIP) -e '.[studio]'
	@touch $@ $(VENV)/.core

$(VENV)/.test: pyproject.toml constraints.txt $(NATIVE) | $(BIN)/python
	$(PIP) -e '.[test]'
	@touch $@ $(VENV)/.core

$(VENV)/.mutation: pyproject.toml constraints.txt $(NATIVE) | $(BIN)/python
	$(PIP) -e '.[mutation]'
	@touch $@ $(VENV)/.test $(VENV)/.core

$(VENV)/.full: pyproject.toml constraints.txt $(NATIVE) | $(BIN)/python
	$(PIP) -e '.[test,full]'
# OpenCV with omnidir, in a separate folder, as it conflicts with the installed OpenCV; tests use it in a separate process.
	$(PIP) --upgrade --no-deps --target $(VENV)/opencv-contrib opencv-contrib-python-headless
	@touch $@
