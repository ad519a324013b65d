# `make test` checks everything and installs what it needs (Rust, Python >= 3.10 and a C compiler must be there).
# Data: recordings in $INSNAV_DATA or ../shared/data; without them the tests that need them say SKIPPED.

SHELL := /bin/bash
.SHELLFLAGS := -e -o pipefail -c
.NOTPARALLEL:
.DEFAULT_GOAL := help

PYTHON ?= python3
CARGO ?= cargo
export PYTHON
INSNAV_DATA ?= $(wildcard $(abspath ../shared/data))
ifneq ($(INSNAV_DATA),)
export INSNAV_DATA
endif

# A fresh clone must build from the lock file as committed.
ifeq ($(CI),true)
LOCKED := --locked
export CARGO_INCREMENTAL ?= 0
export CARGO_PROFILE_DEV_DEBUG ?= 0
export CARGO_TERM_COLOR ?= never
endif

EMBEDDED := thumbv7em-none-eabihf
DRIVE := $(or $(INSNAV_DATA),../shared/data)/mcap_real/rtkexp_drive_ros2_zstd.mcap
OUT := target/check
SKIPS := $(OUT)/skipped
VENV_PYTHON := .venv/bin/python

comma := ,

define step
@printf '\n== %s\n' "$(1)"
endef

# $(call skip,what,why): said at once, and again at the end.
skip = echo "SKIPPED: $(1): $(2)" | tee -a $(SKIPS)

.PHONY: help
help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.PHONY: test
# The wheel as its users get it.
test: PROFILE ?= release
test: begin format clippy docs rust no-std python docs-python examples clean-python validators ## Check everything: format, lints, docs, Rust, no_std, wheel, Python and its examples, foreign readers
	@printf '\n== Result\n'
	@if [ -s $(SKIPS) ]; then cat $(SKIPS); echo "make test: all checks that ran passed, $$(wc -l <$(SKIPS) | tr -d ' ') skipped"; \
	else echo "make test: all checks passed"; fi

.PHONY: begin
begin:
	@mkdir -p $(OUT) && rm -f $(SKIPS)
	@$(CARGO) fmt --version >/dev/null 2>&1 && $(CARGO) clippy --version >/dev/null 2>&1 || rustup component add rustfmt clippy

.PHONY: format
format: ## Rust code is formatted
	$(call step,Format)
	$(CARGO) fmt --all --check

.PHONY: clippy
clippy: ## No lint in any target, benches included
	$(call step,Clippy)
	$(CARGO) clippy $(LOCKED) --workspace --all-targets -- -D warnings

.PHONY: docs
docs: ## Documentation builds without warnings
	$(call step,Documentation)
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc $(LOCKED) --workspace --no-deps

.PHONY: rust
rust: ## Rust tests, examples in the documentation included
	$(call step,Rust tests)
	$(CARGO) test $(LOCKED) --no-fail-fast

# Monte Carlo with as many runs as the bars were set for.
.PHONY: long
long: ## Every Rust test with the full number of simulated runs, and the bench of standing
	$(call step,Rust tests$(comma) long)
	INSNAV_LONG=1 $(CARGO) test $(LOCKED) --no-fail-fast
	$(CARGO) bench $(LOCKED) --bench standing

# The host proves only that nothing asks for `std` features; bare metal proves that nothing links `std` too.
.PHONY: no-std
no-std: begin ## The core builds without std, for a microcontroller where its target can be had
	$(call step,Core without std)
	@target="--target $(EMBEDDED)"; \
	if ! rustc --print target-libdir --target $(EMBEDDED) 2>/dev/null | xargs -I{} test -d {} \
	    && ! timeout 120 rustup target add $(EMBEDDED); then \
	    target=""; $(call skip,core for $(EMBEDDED),the target is not installed and cannot be fetched); fi; \
	for crate in insnav-core insnav; do \
	    echo "$(CARGO) build -p $$crate --no-default-features --features libm $$target"; \
	    $(CARGO) build $(LOCKED) -p $$crate --no-default-features --features libm $$target || exit 1; done

.PHONY: venv
venv:
	@.ci/venv .venv python/requirements-test.txt

.PHONY: wheel
wheel: venv ## Build and install the Python wheel into .venv (as fast to build as the Rust tests; PROFILE=release for speed)
	$(call step,Wheel)
	@rm -rf $(OUT)/wheel
	cd python && ../.venv/bin/maturin build $(LOCKED) --profile $(or $(PROFILE),dev) -i ../$(VENV_PYTHON) -o ../$(OUT)/wheel
	$(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet --no-deps --force-reinstall $(OUT)/wheel/*.whl

# The command and a program on the Rust API, which the wheel is held against; with the features that the Rust tests have built already.
.PHONY: command
command:
	$(CARGO) build $(LOCKED) --bin insnav --example run_log

.PHONY: python
python: wheel command ## Python tests and types, on the wheel
	$(call step,Python tests)
	cd python && INSNAV_COMMAND=$(abspath target/debug/insnav) ../$(VENV_PYTHON) -m pytest
	cd python && ../$(VENV_PYTHON) -m mypy
	cd python && ../$(VENV_PYTHON) -m mypy.stubtest insnav._insnav insnav_command

# Warnings are errors, but that of a key without a line of its own in the source.
.PHONY: docs-python
docs-python: wheel ## Documentation of the Python package, in target/check/docs-python
	$(call step,Python documentation)
	@rm -rf $(OUT)/docs-python
	cd python && ../$(VENV_PYTHON) -W error -W "ignore:Cannot determine where" -m pdoc --docformat numpy -o ../$(OUT)/docs-python insnav

.PHONY: examples
examples: wheel ## Every Python example runs, and its notebook is that of its script
	$(call step,Python examples)
	$(VENV_PYTHON) python/examples/run.py --skips $(SKIPS)

.PHONY: notebooks
notebooks: venv ## Write the notebooks of the Python examples anew
	$(VENV_PYTHON) python/examples/run.py --write

.PHONY: clean-python
clean-python: wheel ## The wheel in an environment with nothing but numpy: size, command, tests
	$(call step,Python with nothing but numpy)
	@status=0; .ci/clean-python $(OUT)/wheel/*.whl $(OUT)/clean-python || status=$$?; \
	if [ $$status = 75 ] && [ "$(CI)" != true ]; then $(call skip,Python with nothing but numpy,the package index cannot be reached); exit 0; fi; \
	exit $$status

.PHONY: validators
validators: command ## Solutions are read by other programs: mcap, rosbags, evo, rerun
	$(call step,Foreign readers)
	@mkdir -p $(OUT)
	@status=0; .ci/venv .venv-validators tests/validators/requirements.txt || status=$$?; \
	if [ $$status = 75 ] && [ "$(CI)" != true ]; then $(call skip,foreign readers,the package index cannot be reached); exit 0; fi; \
	[ $$status = 0 ] || exit $$status; \
	check() { echo "$$1"; .venv-validators/bin/python tests/validators/check_solution.py "$$1"; }; \
	rm -rf $(OUT)/demo; target/debug/insnav demo --dir $(OUT)/demo --format json >$(OUT)/demo.json; \
	check $(OUT)/demo/drive.insnav.mcap; \
	data=$(dir $(DRIVE))..; \
	if [ -d "$$data/mcap_rosbag2" ]; then .venv-validators/bin/python tests/validators/count_messages.py target/debug/insnav \
	    "$$data/mcap_rosbag2" "$$data/mcap_evo" "$$data/mcap_real"; \
	else $(call skip,message counts of other recorders,no folder $$data/mcap_rosbag2); fi; \
	if [ ! -f "$(DRIVE)" ]; then $(call skip,foreign readers of a recorded drive,no file $(DRIVE)); exit 0; fi; \
	target/debug/insnav run "$(DRIVE)" --time-offset auto -o $(OUT)/drive.insnav.mcap --force --format json >$(OUT)/drive.json; \
	check $(OUT)/drive.insnav.mcap

.PHONY: bench
bench: ## Run the benches; hold the instruction counts where valgrind is there, and what Python is to take
	$(CARGO) bench $(LOCKED)
	benches/instructions.sh --check
	$(MAKE) bench-python

.PHONY: bench-python
# Each has its bar, and all are run: what is missed is told at the end.
bench-python: PROFILE = release
bench-python: wheel ## Times of the wheel: an hour of data, import, a step beyond Rust, autocovariance least squares
	$(CARGO) build $(LOCKED) --release --example step_loop
	$(call step,Times of the wheel)
	@missed=0; for bench in "speed.py" "import_time.py --bar-ms 20" "als.py --check" \
	    "step_overhead.py --rust target/release/examples/step_loop --bar-ns 1000"; do \
	    echo "python/benchmarks/$$bench"; $(VENV_PYTHON) python/benchmarks/$$bench || { missed=1; echo "MISSED: $$bench"; }; done; \
	exit $$missed

.PHONY: fmt
fmt: ## Format the Rust code
	$(CARGO) fmt --all

.PHONY: clean
clean: ## Remove what was built and the Python environments
	$(CARGO) clean
	rm -rf .venv .venv-validators
