# SPDX-License-Identifier: Apache-2.0
# The door. It sets up what is missing and calls CMake, which describes all that is compiled (CMakePresets.json).
# What is built goes to build/, .venv/ and host/kontur/lib/.
PYTHON  ?= python3
PY      := .venv/bin/python
IMAGE   := image
TARGET  := qemu vcan slcan inproc
SECONDS := 60
SEED    := 1
SAMPLE  := 200
ROOMS   := core drive
export CTEST_PARALLEL_LEVEL ?= $(shell nproc)
export MPLBACKEND := Agg

.DEFAULT_GOAL := help
.PHONY: help demo test docs test-c test-target test-board test-host test-hil test-install lint lib firmware flash flash-dfu \
  cost fuzz mutants setup clean

# Configure, build and, where it has tests, run each of these presets.
workflow = for preset in $(1); do cmake --workflow --preset $$preset || exit 1; done

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' Makefile
	@echo "Parts of the test: test-c, test-target, test-board, test-host, test-hil, lint. Everything else: docs/testing.md."

demo: lib  ## cut examples/part.ngc under five controllers: table, build/demo/report.html
	.venv/bin/kontur demo --out build/demo

test: test-c test-target test-board test-host test-hil lint  ## test all: C, on a Cortex-M, Python, over the bus; linters

# The C tests with sanitizers, and again to hold the branches that they take. Counts of an earlier run go first.
test-c: setup
	@$(call workflow,test-f32 test-fix test-chk)
	@mkdir -p build/coverage/html; find build -path '*/coverage-*' -name '*.gcda' -delete
	@$(call workflow,coverage-f32 coverage-fix)
	@.venv/bin/gcovr --root . --filter firmware/ --merge-lines --json build/coverage/coverage.json \
	  --gcov-ignore-errors=no_working_dir_found --gcov-suspicious-hits-threshold 0 --html-details build/coverage/html/index.html build/coverage-f32 build/coverage-fix
	@$(PY) tests/unit/check_coverage.py build/coverage/coverage.json tests/unit/uncovered.toml

# QEMU comes first: whether there is one decides what `lib` configures.
test-target: build/need/qemu-system-arm lib firmware
	@cmake --build --preset host-fix --target hash && cmake --build --preset host-f32 --target hash stages
	@$(call workflow,m4-f32 m4-fix m3-fix)
	$(PY) tools/cost.py --check

cost: setup build/need/qemu-system-arm  ## what a servo tick costs: instructions, cycles by a model, stack, flash, RAM
	@cmake --workflow --preset image && cmake --preset host-f32 && cmake --build --preset host-f32 --target stages
	@for preset in m4-f32 m4-fix m3-fix; do \
	  cmake --preset $$preset && cmake --build --preset $$preset --target bench_step || exit 1; done
	@cmake --build --preset m4-f32 --target bench_port
	$(PY) tools/cost.py

# The images on models of the chip's peripherals.
test-board: firmware
	$(PY) -m pytest tests/board -n $(CTEST_PARALLEL_LEVEL)

test-host: lib firmware build/need/qemu-system-arm
	$(PY) -m pytest -n $(CTEST_PARALLEL_LEVEL) --dist loadfile

# On each target, the longest first, as many at once as there are processors. A real drive: make test-hil TARGET=can0
# NO_MOTION=1, and then without NO_MOTION.
test-hil:
	@echo "Drive over its bus: $(TARGET), each told when it is done"
	+@$(MAKE) --no-print-directory -j$(CTEST_PARALLEL_LEVEL) --output-sync=target $(TARGET:%=hil-%)

hil-vcan: build/need/uml
hil-qemu: firmware build/need/qemu-system-arm
hil-%: lib
	@echo "Drive over its bus: $*"
	@$(if $(filter vcan,$*),$(PY) tests/hil/vcan.py) $(PY) -m pytest tests/hil --target $* $(if $(NO_MOTION),--no-motion)

# Source package, wheel and checkout, each in empty environments. No part of `test`: it loads many packages.
test-install: setup
	$(PY) -m pytest tests/install -v -rs

lint: setup
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy host/kontur
	@$(call workflow,lint)

docs: setup  ## the documentation as a site, links checked: build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --quiet

lib: setup  ## the simulated drive: a library for each numeric back end, and the process kontur-sim
	@$(call workflow,host-f32 host-fix host-chk)

firmware: setup build/need/arm  ## the images for an STM32F405: build/firmware/kontur.elf .bin .hex .dfu, and variants
	@$(call workflow,image image-20khz image-feather image-feather-20khz)

flash: build/need/openocd  ## write IMAGE=image to a board by ST-Link; stored parameters stay
flash-dfu: build/need/dfu-util  ## write it by USB to the chip's boot loader (BOOT0 high)
flash flash-dfu: setup build/need/arm
	@$(call workflow,$(IMAGE)) && cmake --build --preset $(IMAGE) --target $@

fuzz: setup build/need/clang  ## run each fuzzer for SECONDS=60 from SEED=1
	@$(call workflow,fuzz-asan)
	$(PY) tests/fuzz/campaign.py --short $(SECONDS) $(SEED)

mutants: setup  ## put SAMPLE=200 faults into ROOMS="core drive" from SEED=1, and see a C test fail at each
	@cmake --preset mutants && cmake --build --preset mutants
	@nice $(PY) tests/unit/mutants.py build/mutants $(ROOMS) --sample $(SAMPLE) --seed $(SEED) --json build/mutants/mutants.json

setup: .venv/stamp  ## Debian packages, installed by apt-get where it may, and the Python environment

clean:  ## remove what is built, but not the Python environment
	rm -rf build host/kontur/lib

.venv/stamp: requirements.lock pyproject.toml | build/need/debian
	@echo "Making .venv: Python packages of requirements.lock (some 150 MB to load)"
	@$(PYTHON) -m venv .venv
	@$(PY) -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	@$(PY) -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

# Debian packages, and what fails without them
build/need/debian:
	@tools/need.sh $@ 'echo "#include <stdint.h>" | $${CC:-cc} -E - && cmake --version && ninja --version && \
	  $(PYTHON) -c "import ensurepip"' gcc libc6-dev cmake ninja-build python3 python3-venv
build/need/arm:
	@tools/need.sh $@ 'echo "#include <string.h>" | arm-none-eabi-gcc -E -' gcc-arm-none-eabi libnewlib-arm-none-eabi
build/need/uml: .venv/stamp  # where this kernel has no vcan, User-Mode Linux has
	@tools/need.sh $@ '$(PY) tests/hil/vcan.py --ready' user-mode-linux kmod iproute2
build/need/clang:  # libFuzzer's library is a package of its own
	@tools/need.sh $@ 'echo "int LLVMFuzzerTestOneInput(void) { return 0; }" | \
	  clang -fsanitize=fuzzer -fsanitize=address -x c - -o /dev/null' clang libclang-rt-dev
build/need/qemu-system-arm build/need/openocd build/need/dfu-util:
	@tools/need.sh $@ 'command -v $(@F)' $(@F)
