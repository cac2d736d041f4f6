# make demo    install into .venv, render the spheres scene with both materials, say where the picture is
# make test    formatting, lints, Rust tests, plugin build, Python tests
# make bench   speed, as ratios measured in one run
# make gallery every effect off and on, and what it costs: docs/gallery.png
# make report  what accuracy costs in time: measure, and write out/accuracy/report.html
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := $(shell find rust-core/src mitsuba-plugin -type f -not -path '*/__pycache__/*' -not -path '*/build/*') \
           Cargo.toml Cargo.lock .cargo/config.toml rust-core/Cargo.toml rust-core/build.rs
DEMO := out/demo

.PHONY: demo test rust-test python-test bench gallery report format clean tools

demo: $(VENV)/installed
	$(BIN)/sgtd compare scenes/spheres.xml -o $(DEMO) --set distribution=student --set gamma=1.6
	@echo
	@echo "The picture: $(CURDIR)/$(DEMO)/comparison.png"

test: rust-test python-test
	@echo "All checks passed."

rust-test: tools
	cargo fmt --check
	cargo clippy --locked --all-targets --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --quiet
	cargo test --locked --release

python-test: $(VENV)/test-tools
	$(BIN)/ruff format --check --quiet mitsuba-plugin tests benches
	$(BIN)/ruff check --quiet mitsuba-plugin tests benches
	$(BIN)/clang-format --dry-run --Werror mitsuba-plugin/src/*.cpp mitsuba-plugin/src/*.h
	$(BIN)/python -m pytest tests

bench: $(VENV)/installed
	cargo bench --locked --bench ratios
	$(BIN)/python benches/render.py
	$(BIN)/python benches/effects.py

gallery: $(VENV)/installed
	$(BIN)/python benches/gallery.py

report: $(VENV)/installed
	$(BIN)/sgtd accuracy -o out/accuracy

format: $(VENV)/test-tools
	cargo fmt
	$(BIN)/ruff format mitsuba-plugin tests benches
	$(BIN)/clang-format -i mitsuba-plugin/src/*.cpp mitsuba-plugin/src/*.h

# What a bare Debian machine lacks: the venv module, libLLVM, a recent cargo. The first two are installed where apt can.
tools:
	@tools/prepare

$(BIN)/python: | tools
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip

$(VENV)/installed: $(BIN)/python $(SOURCES)
	@echo "Building the plugin and installing it into $(VENV) (about two minutes on two cores) ..."
	$(BIN)/python -m pip install --quiet --disable-pip-version-check ./mitsuba-plugin
	@touch $@

$(VENV)/test-tools: $(VENV)/installed tests/requirements.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r tests/requirements.txt
	@touch $@

clean:
	rm -rf $(VENV) target out mitsuba-plugin/build
