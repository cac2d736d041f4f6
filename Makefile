# make demo    install into .venv, render the spheres scene with both materials, say where the picture is
# make test    formatting, lints, types, Rust tests, plugin build, Python tests
# make quick   the same with one case of each test, for every change
# make bench   speed, as ratios measured in one run
# make microsurface a mesh beside the material of the same shape: docs/microsurface.png
# make gallery every effect off and on, and what it costs: docs/gallery.png
# make docs    the documentation site, from sources, docstrings and executed notebooks: out/docs/index.html
# make dist    a source distribution and a wheel in dist/
# make report  what accuracy costs in time: measure, and write out/accuracy/report.html
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Each worker is a process of pytest with a variant of Mitsuba of its own
WORKERS := -n 2 --dist loadgroup
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
SOURCES := $(shell find rust-core/src mitsuba-plugin -type f -not -path '*/__pycache__/*' -not -path '*/build/*') \
           pyproject.toml Cargo.toml Cargo.lock .cargo/config.toml rust-core/Cargo.toml rust-core/build.rs
DEMO := out/demo

.PHONY: demo test quick rust-test python-test lint bench gallery microsurface docs dist report format clean tools

demo: $(VENV)/installed
	$(BIN)/sgtd compare scenes/spheres.xml -o $(DEMO) --set distribution=student --set gamma=1.6
	@echo
	@echo "The picture: $(CURDIR)/$(DEMO)/comparison.png"

test: rust-test python-test
	@echo "All checks passed."

rust-test: tools
	cargo fmt --all --check
	cargo clippy --locked --profile checked --workspace --all-targets --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --quiet
	cargo test --locked --profile checked

python-test: lint
	$(BIN)/python -m pytest tests $(WORKERS)

lint: $(VENV)/test-tools
	$(BIN)/ruff format --check --quiet mitsuba-plugin tests benches examples docs/*.py docs/extensions
	$(BIN)/ruff check --quiet mitsuba-plugin tests benches examples docs/*.py docs/extensions
	$(BIN)/clang-format --dry-run --Werror mitsuba-plugin/src/*.cpp mitsuba-plugin/src/*.h
	$(BIN)/mypy

quick: tools lint
	cargo fmt --all --check
	cargo test --locked --profile checked --quiet --test laws --test tree --test validation
	$(BIN)/python -m pytest tests --quick --quiet $(WORKERS)

bench: $(VENV)/installed
	cargo bench --locked --package sgtd-benches --bench ratios
	$(BIN)/python benches/render.py
	$(BIN)/python benches/equal_time.py
	$(BIN)/python benches/effects.py
	$(BIN)/python benches/gradients.py

gallery: $(VENV)/installed
	$(BIN)/python benches/gallery.py

microsurface: $(VENV)/installed
	$(BIN)/python benches/microsurface.py

docs: $(VENV)/docs-tools
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m sphinx -W --keep-going -q -b html docs out/docs
	@echo "The site: $(CURDIR)/out/docs/index.html"

report: $(VENV)/installed
	$(BIN)/sgtd accuracy -o out/accuracy

format: $(VENV)/test-tools
	cargo fmt --all
	$(BIN)/ruff format mitsuba-plugin tests benches examples docs/*.py docs/extensions
	$(BIN)/clang-format -i mitsuba-plugin/src/*.cpp mitsuba-plugin/src/*.h

# Says what a bare Debian machine lacks: a compiler, the venv module, libLLVM, a recent cargo; installs it with CI=true.
tools:
	@tools/prepare

$(BIN)/python: | tools
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip

# What the plugin is built with stands in the environment itself, so that a second build compiles only what has changed.
$(VENV)/build-tools: $(BIN)/python pyproject.toml
	@sed -n 's/^requires = \[\(.*\)\]/\1/p' pyproject.toml | sed 's/", "/\n/g; s/"//g' > $(VENV)/build-tools.txt
	$(PIP) -r $(VENV)/build-tools.txt
	@touch $@

$(VENV)/installed: $(VENV)/build-tools $(SOURCES)
	@echo "Building the plugin and installing it into $(VENV) (about two minutes on two cores) ..."
	PATH="$(CURDIR)/$(BIN):$$PATH" $(PIP) --no-build-isolation ".[compare,report,fit]"
	@touch $@

$(VENV)/test-tools: $(VENV)/installed tests/requirements.txt
	$(PIP) -r tests/requirements.txt
	@touch $@

$(VENV)/docs-tools: $(VENV)/installed docs/requirements.txt
	$(PIP) -r docs/requirements.txt
	@touch $@

# What can be published: a source distribution, and a wheel for this Python; tools/wheels makes them for others too
dist: | $(BIN)/python
	$(BIN)/python tools/wheels

clean:
	rm -rf $(VENV) target out build dist
