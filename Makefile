# SPDX-License-Identifier: Apache-2.0
# Everything that is built goes to build/, .venv/ and host/kontur/lib/; `make clean` removes the first and the last.
# V=1 shows the commands.

ifeq ($(origin CC),default)
CC       := gcc
endif
PYTHON   ?= python3
UNITY_DIR ?= build/unity/src
Q        := $(if $(V),,@)

VENV     := .venv
PY       := $(VENV)/bin/python
KONTUR   := $(VENV)/bin/kontur
LIB      := host/kontur/lib

WARN     := -Wall -Wextra -Werror -Wconversion -Wdouble-promotion -Wshadow -Wmissing-prototypes -Wstrict-prototypes
CFLAGS   := -std=c11 -O2 -g -ffp-contract=off -fno-math-errno $(WARN)
SANITIZE := -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer
INCLUDE  := -Ifirmware -I. -Ibuild/gen
TEST_INCLUDE := -Itests/unit -Itests/golden
UNITY    := -DUNITY_INCLUDE_DOUBLE -DUNITY_SUPPORT_64 -I$(UNITY_DIR)

# Numeric back ends (firmware/core/num.h). Fixed point is compiled with no floating-point registers to use.
NUMS     := f32 fix chk
fix_FLAGS := -DKONTUR_NUM_FIX
chk_FLAGS := -DKONTUR_NUM_CHK
# Multiply-add as one instruction where this host has it; else it is the C library's, with the same bits (num_f32.h).
f32_HOST  = $(if $(shell $(CC) -march=native -dM -E - </dev/null 2>/dev/null | grep -w __FMA__),-mfma)
NO_FLOAT := -mgeneral-regs-only
# The control core and the servo tick for a microcontroller: optimised as a whole. What is left out moves values that the few
# registers cannot hold: 3 % of the tick's instructions; and makes one function of equal ones, which the call graph would not know.
TICK_FLAGS := -O3 -flto=auto -fno-if-conversion -fno-gcse -fno-ipa-icf
TICK_SOURCES := $(wildcard firmware/core/*.c) $(addprefix firmware/,drive/encoder.c drive/servo_loop.c drive/telemetry.c motion/path_clock.c onchip/onchip_plant.c) \
	$(addprefix firmware/port/stm32f405/,encoder.c inputs.c output.c)

GENERATED := build/gen/od/od_gen.c build/gen/scope/signal_gen.c build/gen/supervision/fault_gen.c
ROOMS    := core od canopen motion supervision scope drive onchip
FIRMWARE := $(wildcard firmware/*.c $(ROOMS:%=firmware/%/*.c)) $(GENERATED)
SOURCES  := $(FIRMWARE) sim/flash.c sim/libkontur.c sim/plant.c
chk_SOURCES := sim/chk_fail.c
PORT_SOURCES := firmware/port/slcan.c firmware/port/linux/pace.c firmware/port/linux/can_errors.c  # not in the library, but tested with it
PORT     := firmware/port/stm32f405
# What of the STM32F405's port a host can run, on the registers of tests/unit/chip.c
CHIP_SOURCES := $(filter-out %/start.c %/wait.c,$(wildcard $(PORT)/*.c)) tests/unit/chip.c
# Tests that need the host: a simulated chip's registers, more memory than a chip has
HOST_TESTS := device bitflip can_errors chk fuzz machine_file pace power_cut sim slcan store $(patsubst tests/unit/test_%.c,%,$(wildcard tests/unit/test_port_*.c))
# Every test runs on float32; those of what computes with `num` run on the other back ends, too.
TESTS    := $(patsubst tests/unit/test_%.c,%,$(wildcard tests/unit/test_*.c))
NUM_TESTS := smc cascade chk closed_loop contour drive energy faults_axes faults_device faults_path golden homing ip feedforward servo_loop onchip_plant axis_modes num observer on_chip configuration path_clock scope servo spline trig compensator
# Not for the checking back end: in these an encoder jumps, or a fault pushes an axis, out of the range of `num`, where fixed point
# saturates and chk stops; and it has no words of its own.
NOT_CHK  := drive faults_axes faults_device faults_path golden servo_loop
TEST_PROGRAMS := $(TESTS:%=build/unit/f32/test_%) $(NUM_TESTS:%=build/unit/fix/test_%) \
	$(patsubst %,build/unit/chk/test_%,$(filter-out $(NOT_CHK),$(NUM_TESTS)))
# The same tests, built to count the branches that they take: those of the source, so not optimised and without the sanitizers' own.
# Less fuzz: random input takes branches whose outcome no test looks at.
COVERAGE := -O0 --coverage
COVERAGE_PROGRAMS := $(patsubst %,build/coverage/f32/test_%,$(filter-out fuzz,$(TESTS))) $(NUM_TESTS:%=build/coverage/fix/test_%)
BUILD_ID := $(shell git describe --always --dirty 2>/dev/null || echo unknown)
VERSION  := $(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
HEADERS  := $(wildcard firmware/*.h firmware/*/*.h firmware/port/*/*.h sim/*.h)
objects   = $(patsubst %.c,$(1)/$(2)/%.o,$(SOURCES) $($(2)_SOURCES))  # folder, back end

export MPLBACKEND := Agg

.DELETE_ON_ERROR:
.SECONDARY:
.DEFAULT_GOAL := help
.PHONY: help test-target cost cost-programs firmware flash flash-dfu golden demo paper test test-c test-host test-hil lint bench lib setup clean FORCE

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-11s %s\n", $$1, $$2 }' Makefile

demo: setup lib  ## cut examples/part.ngc under five controllers: table, build/demo/report.html
	$(KONTUR) demo

paper: setup lib  ## run the paper again: docs/paper.md and its pictures (some minutes)
	$(PY) tools/paper_page.py docs/paper.md

test: setup test-c coverage test-target test-host test-hil lint  ## all tests: C (Unity, with sanitizers; branches), Python (pytest), over the bus, lint

test-c: $(TEST_PROGRAMS)  ## the C tests alone
	@failed=0; for t in $^; do \
	  if $$t >$$t.log 2>&1; then printf '%-32s %s\n' $${t#build/unit/} "$$(grep -E '^[0-9]+ Tests' $$t.log)"; \
	  else failed=1; printf '%-32s FAILED\n' $${t#build/unit/}; grep -v ':PASS$$' $$t.log; fi; done; \
	if [ $$failed = 0 ]; then echo "C tests: $(words $^) programs passed"; else echo "C tests: FAILED"; exit 1; fi

test-host: setup lib firmware-all build/qemu.stamp  ## the Python tests alone, those of the image in QEMU among them
	$(PY) -m pytest

# On each target in turn; a real drive: make test-hil TARGET=can0 NO_MOTION=1, and then without NO_MOTION.
HIL      := $(or $(TARGET),inproc slcan vcan qemu)
test-hil: setup lib $(if $(filter vcan,$(HIL)),build/uml.stamp) $(if $(filter qemu,$(HIL)),firmware build/qemu.stamp)  ## the drive over its bus: TARGET=inproc, slcan, vcan, qemu (default: all), can0
	@for target in $(HIL); do echo "Drive over its bus: $$target"; \
	  case $$target in vcan) vcan="$(PY) tests/hil/vcan.py";; *) vcan=;; esac; \
	  $$vcan $(PY) -m pytest tests/hil --target $$target $(if $(NO_MOTION),--no-motion) || exit 1; done

lint: setup lib build/debian.stamp $(GENERATED)  ## ruff, mypy --strict; clang-tidy, gcc -fanalyzer, cppcheck with MISRA C:2012
	$(VENV)/bin/ruff check host tools reference tests firmware examples
	$(VENV)/bin/ruff format --check host tools reference tests firmware examples
	$(VENV)/bin/mypy host/kontur
	$(Q)$(MAKE) --no-print-directory -j$(shell nproc) lint-c

golden: build/unit/f32/write_golden build/unit/fix/write_golden  ## write the golden vectors anew (tests/golden/README.md)
	build/unit/f32/write_golden >tests/golden/golden_f32.h
	build/unit/fix/write_golden >tests/golden/golden_fix.h

bench: setup lib cost-programs  ## speed of the simulated drive; instructions of a servo tick by stage, stack, flash, RAM
	$(KONTUR) bench sim
	$(PY) tools/cost.py

lib: $(NUMS:%=$(LIB)/libkontur_%.so) $(LIB)/kontur_sim.h $(LIB)/kontur-sim  ## firmware and simulated machine as a shared library, for each numeric back end, and as a process

setup: $(VENV)/stamp  ## system packages (installed by apt-get where it may) and the Python environment

clean:  ## remove everything built, but the Python environment
	rm -rf build $(LIB)

# --- set-up -----------------------------------------------------------------------------------------------------------
# The Debian packages that a build needs and this machine lacks, found by trying.
build/debian.stamp:
	@mkdir -p build; missing=; \
	command -v $(CC) >/dev/null || missing="$$missing gcc"; \
	echo '#include <stdint.h>' | $(CC) -E - >/dev/null 2>&1 || missing="$$missing libc6-dev"; \
	$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || missing="$$missing python3 python3-venv"; \
	if [ -n "$$missing" ]; then $(call install,$$missing); fi; \
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { echo "make: Python 3.10 or newer is needed; name it with PYTHON=..."; exit 1; }; \
	touch $@

$(VENV)/stamp: requirements.lock pyproject.toml | build/debian.stamp
	@echo "Making $(VENV): Python packages of requirements.lock (some 150 MB to load)"
	$(Q)$(PYTHON) -m venv $(VENV)
	$(Q)$(PY) -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(Q)$(PY) -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

# Install Debian packages: $(call install,packages); one recipe at a time, whatever -j says.
define install
{ exec 9>build/apt.lock; flock 9; \
	  if [ "$$(id -u)" = 0 ]; then root=; elif sudo -n true 2>/dev/null; then root="sudo -n"; else root=no; fi; \
	  if [ "$$root" = no ] || ! command -v apt-get >/dev/null; then \
	    echo "make: Debian packages are missing; install them, e.g. with: sudo apt-get install" $(1); exit 1; fi; \
	  echo "Installing Debian packages:" $(1); \
	  $$root apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$root apt-get install -y -qq --no-install-recommends $(1) || exit 1; }
endef
# The same unless a trial of what is needed succeeds, and it has to succeed afterwards: $(call debian,trial,packages)
define debian
	mkdir -p build; try() { $(1); } >build/debian.log 2>&1; try || { $(call install,$(2)); try || { cat build/debian.log; \
	  echo "make: fails with these Debian packages installed: $(2)"; exit 1; }; }; touch $@
endef

# --- library ----------------------------------------------------------------------------------------------------------
build/gen/od/od_gen.c: firmware/od/objects.toml tools/source.py tools/objects.py tools/dbc.py tools/generate_objects.py | $(VENV)/stamp
	@echo "  GEN objects.toml"
	$(Q)$(PY) tools/generate_objects.py build/gen/od --eds host/kontur/kontur.eds --dbc host/kontur/kontur.dbc --docs docs/objects.md

build/gen/scope/signal_gen.c: firmware/scope/signals.toml firmware/od/objects.toml tools/objects.py tools/generate_signals.py | $(VENV)/stamp
	@echo "  GEN signals.toml"
	$(Q)$(PY) tools/generate_signals.py build/gen --docs docs/signals.md --json host/kontur/signals.json

build/gen/supervision/fault_gen.c: firmware/supervision/faults.toml tools/source.py tools/generate_faults.py | $(VENV)/stamp
	@echo "  GEN faults.toml"
	$(Q)$(PY) tools/generate_faults.py build/gen/supervision --docs docs/faults.md --json host/kontur/fault_table.json

# Made by the same commands; without this rule make would not see in the same run that it has changed.
$(GENERATED:.c=.h): %.h: %.c ;
build/gen/supervision/fault_rows.h: build/gen/supervision/fault_gen.c ;
build/gen/supervision/snapshot_gen.h build/gen/drive/telemetry_gen.h: build/gen/scope/signal_gen.c ;

# The build id is compiled into one file, again when it has changed.
build/build_id: FORCE
	@mkdir -p build; echo '$(BUILD_ID)' | cmp -s - $@ || echo '$(BUILD_ID)' >$@
FORCE:
APP      := $(foreach n,$(NUMS),$(foreach f,lib unit coverage,build/$(f)/$(n)/firmware/device.o))
$(APP): build/build_id
$(APP): CFLAGS += -DKONTUR_BUILD_ID='"$(BUILD_ID)"' -DKONTUR_VERSION='"$(VERSION)"'
$(FIRMWARE:%.c=build/lib/fix/%.o): CFLAGS += $(NO_FLOAT)

# For the back end $(1): build/lib/$(1) holds the objects of its library.
define back_end
build/lib/$(1)/%.o: %.c | build/debian.stamp $(GENERATED)
	@mkdir -p $$(@D); echo "  CC  $$< ($(1))"
	$(Q)$(CC) $$(CFLAGS) $($(1)_FLAGS) $$($(1)_HOST) -fPIC $(INCLUDE) -MMD -MP -c $$< -o $$@

$(LIB)/libkontur_$(1).so: $(call objects,build/lib,$(1))
	@mkdir -p $$(@D); echo "  LD  $$@"
	$(Q)$(CC) -shared -Wl,-Bsymbolic -o $$@ $$^ -lm

build/unit/$(1)/write_golden: tests/golden/write.c build/unit/$(1)/libkontur.a
	$(Q)$(CC) $$(CFLAGS) $($(1)_FLAGS) $$($(1)_HOST) $(SANITIZE) $(INCLUDE) $(TEST_INCLUDE) $$^ -lm -o $$@
endef
$(foreach n,$(NUMS),$(eval $(call back_end,$(n))))

# The tests for the back end $(1) with their objects in build/$(2)/$(1), compiled with the flags $(3).
define back_end_tests
build/$(2)/$(1)/%.o: %.c | build/debian.stamp $(GENERATED)
	@mkdir -p $$(@D); echo "  CC  $$< ($(1), $(2))"
	$(Q)$(CC) $$(CFLAGS) $($(1)_FLAGS) $$($(1)_HOST) $(3) $(INCLUDE) $(TEST_INCLUDE) -MMD -MP -c $$< -o $$@

build/$(2)/$(1)/libkontur.a: $(call objects,build/$(2),$(1)) $(PORT_SOURCES:%.c=build/$(2)/$(1)/%.o) \
		$(if $(filter f32,$(1)),$(CHIP_SOURCES:%.c=build/$(2)/f32/%.o)) $(if $(filter-out chk,$(1)),build/$(2)/$(1)/tests/golden/golden.o)
	@rm -f $$@
	$(Q)ar rcs $$@ $$^

build/$(2)/$(1)/test_%: tests/unit/test_%.c build/$(2)/unity.o build/$(2)/$(1)/libkontur.a
	@echo "  CC  $$< ($(1))"
	$(Q)$(CC) $$(CFLAGS) $($(1)_FLAGS) $$($(1)_HOST) $(3) $(INCLUDE) $(TEST_INCLUDE) $(UNITY) -MMD -MP -MF $$@.d $$< build/$(2)/unity.o build/$(2)/$(1)/libkontur.a -lm -o $$@
endef
$(foreach n,$(NUMS),$(eval $(call back_end_tests,$(n),unit,$(SANITIZE))))
$(foreach n,f32 fix,$(eval $(call back_end_tests,$(n),coverage,$(COVERAGE))))

$(LIB)/kontur_sim.h: sim/kontur_sim.h
	@mkdir -p $(@D); cp $< $@

# The Linux port: a process that loads one of the libraries beside it.
LINUX    := $(patsubst %.c,build/linux/%.o,firmware/port/slcan.c $(wildcard firmware/port/linux/*.c))
build/linux/%.o: %.c | build/debian.stamp
	@mkdir -p $(@D); echo "  CC  $<"
	$(Q)$(CC) $(CFLAGS) -D_GNU_SOURCE $(INCLUDE) -MMD -MP -c $< -o $@

$(LIB)/kontur-sim: $(LINUX)
	@mkdir -p $(@D); echo "  LD  $@"
	$(Q)$(CC) -o $@ $^ -ldl

# --- image ------------------------------------------------------------------------------------------------------------
# The STM32F405 image. BOARD=feather builds it for firmware/port/stm32f405/board_feather.h, CONTROL_HZ=20000 for servo ticks at 20 kHz;
# each has its own name: kontur-feather.elf, kontur-20khz.elf, kontur-feather-20khz.elf.
BOARD    := kontur
CONTROL_HZ := 10000
IMAGE_NAME := kontur$(if $(filter-out kontur,$(BOARD)),-$(BOARD))$(if $(filter-out 10000,$(CONTROL_HZ)),-$(CONTROL_HZ:%000=%khz))
VARIANT  := build/firmware/$(BOARD)-$(CONTROL_HZ)
ARM      := arm-none-eabi-
IMAGE    := $(VARIANT)/kontur
ARM_CPU  := -mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard
ARM_FLAGS := $(ARM_CPU) $(CFLAGS) -ffunction-sections -fdata-sections -fno-common -fcallgraph-info=su -DKONTUR_BUILD_ID='"$(BUILD_ID)"' \
	-DKONTUR_VERSION='"$(VERSION)"' -DBOARD_HEADER='"port/stm32f405/board_$(BOARD).h"' \
	-DCONTROL_HZ=$(CONTROL_HZ)u
IMAGE_SOURCES := $(FIRMWARE) $(wildcard firmware/port/*.c $(PORT)/*.c)
IMAGE_OBJECTS := $(IMAGE_SOURCES:%.c=$(VARIANT)/%.o)

firmware: $(IMAGE).elf $(IMAGE).bin $(IMAGE).hex $(IMAGE).dfu  ## the image for an STM32F405: build/firmware/kontur.elf .bin .hex .dfu; BOARD=feather, CONTROL_HZ=20000
	$(Q)$(PY) $(PORT)/check_image.py $(IMAGE).elf --map $(IMAGE).map --tools $(ARM)
	@for f in elf bin hex dfu; do cp $(IMAGE).$$f build/firmware/$(IMAGE_NAME).$$f; done

# The other images: what a test builds and runs, so that they do not rot.
firmware-all: firmware
	@$(MAKE) --no-print-directory firmware CONTROL_HZ=20000
	@$(MAKE) --no-print-directory firmware BOARD=feather
.PHONY: firmware-all

flash: firmware build/openocd.stamp  ## write it to a board by ST-Link (OpenOCD); parameters stay
	openocd -f interface/stlink.cfg -f target/stm32f4x.cfg -c 'program $(IMAGE).elf verify reset exit'

flash-dfu: firmware build/dfu-util.stamp  ## write it to a board by USB in its boot loader (BOOT0 high); parameters stay
	dfu-util --device 0483:df11 --alt 0 --reset --download $(IMAGE).dfu

# The Debian packages of these targets
build/arm.stamp: $(VENV)/stamp
	$(Q)$(call debian,echo '#include <string.h>' | $(ARM)gcc -E -,gcc-arm-none-eabi libnewlib-arm-none-eabi)
build/openocd.stamp:
	$(Q)$(call debian,command -v openocd,openocd)
build/dfu-util.stamp:
	$(Q)$(call debian,command -v dfu-util,dfu-util)
# Where this kernel has no vcan, User-Mode Linux has.
build/uml.stamp: $(VENV)/stamp
	$(Q)$(call debian,$(PY) tests/hil/vcan.py --ready,user-mode-linux kmod iproute2)
build/qemu.stamp:
	$(Q)$(call debian,command -v qemu-system-arm,qemu-system-arm)

# Made before the call graphs were, an object has none.
$(VARIANT)/flags: FORCE
	@mkdir -p $(@D); echo '$(ARM_CPU) $(CFLAGS) -fcallgraph-info=su' | cmp -s - $@ || echo '$(ARM_CPU) $(CFLAGS) -fcallgraph-info=su' >$@

$(VARIANT)/%.o: %.c $(VARIANT)/flags | build/arm.stamp $(GENERATED)
	@mkdir -p $(@D); echo "  ARM $<"
	$(Q)$(ARM)gcc $(ARM_FLAGS) $(INCLUDE) -MMD -MP -c $< -o $@

$(VARIANT)/firmware/device.o: build/build_id

$(TICK_SOURCES:%.c=$(VARIANT)/%.o): ARM_FLAGS += $(TICK_FLAGS)

$(IMAGE).elf: $(IMAGE_OBJECTS) $(PORT)/kontur.ld
	@echo "  LD  $@"
	$(Q)$(ARM)gcc $(ARM_FLAGS) $(TICK_FLAGS) -nostartfiles --specs=nano.specs -Wl,--gc-sections -Wl,--fatal-warnings -Wl,-Map=$(IMAGE).map -T $(PORT)/kontur.ld \
	  $(IMAGE_OBJECTS) -o $@

# Between the two parts of the image lie the parameters: the .bin has FFh there, and flashing it erases them.
$(IMAGE).bin: $(IMAGE).elf
	$(Q)$(ARM)objcopy -O binary --gap-fill 0xFF $< $@
$(IMAGE).hex: $(IMAGE).elf
	$(Q)$(ARM)objcopy -O ihex $< $@
$(IMAGE).dfu: $(IMAGE).elf $(PORT)/dfuse.py
	$(Q)$(PY) $(PORT)/dfuse.py $< $@ --tools $(ARM)

# --- tests on the target ----------------------------------------------------------------------------------------------
# The unit tests, the golden vectors and the closed loop as programs for a Cortex-M in QEMU, with output and exit code by
# semihosting: float32 on the STM32F405 (M4F), fixed point there and on the STM32F205 (M3, no FPU).
TARGETS  := m4-f32 m4-fix m3-fix
m4_CPU   := $(ARM_CPU)
m3_CPU   := -mcpu=cortex-m3 -mthumb
m4_BOARD := netduinoplus2
m3_BOARD := netduino2
cpu       = $(firstword $(subst -, ,$(1)))
back_end_of = $(lastword $(subst -, ,$(1)))
QEMU     := qemu-system-arm -display none -monitor none -serial none -icount shift=0,sleep=off -semihosting-config enable=on,target=native
# What needs the host: registers of a simulated chip (port_*), files (machine_file), the simulators (sim, pace, slcan, can_errors),
# the checking back end (chk), more than 128 KiB of RAM (store, power_cut, bitflip: copies of flash or drive), minutes in QEMU (device, fuzz)
NOT_TARGET := $(HOST_TESTS)
# Each on the processor that its back end is for; the golden vectors of fixed point on both.
TARGET_TESTS := $(foreach t,$(filter-out $(NOT_TARGET),$(TESTS)),m4-f32/test_$(t)) \
	$(foreach t,$(filter-out chk $(NOT_TARGET),$(NUM_TESTS)),m3-fix/test_$(t)) m4-fix/test_golden
target_objects = $(patsubst %.c,build/target/$(1)/%.o,$(FIRMWARE) sim/flash.c sim/plant.c tests/golden/golden.c tests/target/rig.c)
TARGET_INCLUDE := $(INCLUDE) $(TEST_INCLUDE) -Itests/target -Ibuild/target

# Made again when the host's planner may have changed; what includes it is compiled again only when the knots are others.
build/target/part_knots.stamp: tests/target/part_knots.py examples/part.ngc $(wildcard host/kontur/*.py) | $(VENV)/stamp
	@mkdir -p $(@D); echo "  GEN build/target/part_knots.h"
	$(Q)$(PY) tests/target/part_knots.py examples/part.ngc >$(@:.stamp=.new)
	@cmp -s $(@:.stamp=.new) $(@:.stamp=.h) || cp $(@:.stamp=.new) $(@:.stamp=.h); touch $@
build/target/part_knots.h: build/target/part_knots.stamp ;

define on_target
$(TICK_SOURCES:%.c=build/target/$(1)/%.o): CFLAGS += $(TICK_FLAGS)

build/target/$(1)/%.o: %.c | build/target/part_knots.h build/arm.stamp $(GENERATED)
	@mkdir -p $$(@D); echo "  ARM $$< ($(1))"
	$(Q)$(ARM)gcc $($(call cpu,$(1))_CPU) $$(CFLAGS) $($(call back_end_of,$(1))_FLAGS) -ffunction-sections -fdata-sections $$(TARGET_INCLUDE) -MMD -MP -c $$< -o $$@

build/target/$(1)/semihost.o: tests/target/semihost.c | build/arm.stamp
	@mkdir -p $$(@D)
	$(Q)$(ARM)gcc $($(call cpu,$(1))_CPU) $$(CFLAGS) -Itests/target -c $$< -o $$@

build/target/$(1)/unity.o: $(UNITY_DIR)/unity.c | build/arm.stamp
	@mkdir -p $$(@D)
	$(Q)$(ARM)gcc $($(call cpu,$(1))_CPU) -std=c11 -O1 -g $(UNITY) -c $$< -o $$@

build/target/$(1)/firmware.o: $(call target_objects,$(1))
	@echo "  LD  $$@"
	$(Q)$(ARM)gcc $($(call cpu,$(1))_CPU) $$(CFLAGS) $$(TICK_FLAGS) -r -nostdlib -flinker-output=nolto-rel -ffunction-sections -fdata-sections $$^ -o $$@

build/target/$(1)/test_%.elf: tests/unit/test_%.c build/target/$(1)/unity.o build/target/$(1)/semihost.o build/target/$(1)/firmware.o tests/target/semihost.ld
	@echo "  ARM $$< ($(1))"
	$(Q)$(ARM)gcc $($(call cpu,$(1))_CPU) $$(CFLAGS) $($(call back_end_of,$(1))_FLAGS) $$(TARGET_INCLUDE) $(UNITY) -MMD -MP -MF $$@.d $$(filter %.c %.o,$$^) $$(TARGET_LINK) -lm -o $$@

build/target/$(1)/%.elf: tests/target/%.c build/target/$(1)/semihost.o $(call target_objects,$(1)) tests/target/semihost.ld
	@echo "  ARM $$< ($(1))"
	$(Q)$(ARM)gcc $($(call cpu,$(1))_CPU) $$(CFLAGS) $$(TICK_FLAGS) $($(call back_end_of,$(1))_FLAGS) $$(TARGET_INCLUDE) -MMD -MP -MF $$@.d $$(filter %.c %.o,$$^) $$(TARGET_LINK) -o $$@
endef
TARGET_LINK := -nostartfiles --specs=nano.specs -Wl,--gc-sections -T tests/target/semihost.ld
$(foreach n,$(TARGETS),$(eval $(call on_target,$(n))))

# The closed loop of the target on the host, to compare with
$(foreach n,f32 fix,build/target/host-$(n)/hash): build/target/host-%/hash: build/target/part_knots.h $(GENERATED) tests/target/hash.c tests/target/rig.c $(FIRMWARE) \
		$(HEADERS) $(wildcard tests/target/*.h)
	@mkdir -p $(@D); echo "  CC  tests/target/hash.c ($*)"
	$(Q)$(CC) $(CFLAGS) $($*_FLAGS) $($*_HOST) $(TARGET_INCLUDE) $(filter %.c,$^) -lm -o $@

# As many at once as there are processors; the host's hash is what a target's must be.
JOBS     := $(shell nproc 2>/dev/null || echo 1)
test-target: $(TARGET_TESTS:%=build/target/%.elf) $(TARGETS:%=build/target/%/hash.elf) build/target/host-f32/hash build/target/host-fix/hash cost-programs  ## the C tests, the closed loop and its cost on a Cortex-M in QEMU
	@printf '%s\n' $(TARGET_TESTS) $(TARGETS:%=%/hash) | xargs -P $(JOBS) -I{} sh -c 'm=$(m4_BOARD); case {} in m3-*) m=$(m3_BOARD);; esac; \
	  timeout 600 $(QEMU) -machine $$m -kernel build/target/{}.elf </dev/null >build/target/{}.log 2>&1; echo $$? >build/target/{}.exit'; \
	failed=0; \
	for t in $(TARGET_TESTS); do e=build/target/$$t; \
	  if [ "$$(cat $$e.exit)" = 0 ]; then printf '%-32s %s\n' $$t "$$(grep -aE '^[0-9]+ Tests' $$e.log)"; \
	  else failed=1; printf '%-32s FAILED\n' $$t; grep -av ':PASS' $$e.log; fi; done; \
	for n in $(TARGETS); do h=$$(build/target/host-$${n#*-}/hash); t=$$(cat build/target/$$n/hash.log); \
	  if [ -n "$$h" ] && [ "$$h" = "$$t" ]; then echo "closed loop on $$n: $$t, as on the host"; \
	  else failed=1; echo "closed loop on $$n: $$t, on the host: $$h: DIFFERENT"; fi; done; \
	$(PY) tools/cost.py --check || failed=1; \
	if [ $$failed = 0 ]; then echo "target tests: $(words $(TARGET_TESTS)) programs passed"; else echo "target tests: FAILED"; exit 1; fi

# Counts instructions by stage, inside QEMU. Its interface has had version 2 since QEMU 9; what is used of it is the same.
build/target/libstages.so: tests/target/stages.c | build/qemu.stamp
	@mkdir -p $(@D); v=$$(qemu-system-arm --version | sed -n 's/.*version \([0-9]*\).*/\1/p'); if [ "$$v" -ge 9 ]; then v=2; else v=1; fi; \
	$(CC) $(CFLAGS) -DQEMU_PLUGIN_VERSION=$$v -fPIC -shared $< -o $@

build/target/%/cost_scope.json: build/target/%/bench_scope.elf build/qemu.stamp
	$(Q)m=$(m4_BOARD); case $* in m3-*) m=$(m3_BOARD);; esac; timeout 600 $(QEMU) -machine $$m -kernel $< </dev/null >$@ 2>&1

# The image's figures are those of the default board at 10 kHz.
cost-programs: setup firmware $(TARGETS:%=build/target/%/bench_step.elf) build/target/m4-f32/bench_port.elf build/target/libstages.so
DRIVERS  := $(patsubst %,build/target/m4-f32/$(PORT)/%.o,cpu encoder inputs output pins)
build/target/m4-f32/bench_port.elf: $(DRIVERS)

cost: cost-programs  ## write down what the firmware costs: tests/target/cost.json, docs/performance.md
	$(PY) tools/cost.py --write

# --- static analysis --------------------------------------------------------------------------------------------------
# Deviations stand in firmware/deviations.txt. Files are looked at again when they or a header have changed.
LINT_SOURCES := $(wildcard firmware/*.c $(ROOMS:%=firmware/%/*.c) firmware/port/*.c firmware/port/linux/*.c $(PORT)/*.c)
LINT_FLAGS := -std=c11 -D_GNU_SOURCE $(INCLUDE) -DBOARD_HEADER='"port/stm32f405/board_kontur.h"' -DCONTROL_HZ=10000u \
	-DKONTUR_BUILD_ID='""' -DKONTUR_VERSION='""'
CPPCHECK := $(VENV)/bin/cppcheck -q --error-exitcode=1 --std=c11 -D__GNUC__ \
	--enable=warning,style,performance,portability --suppressions-list=firmware/deviations.txt --suppress=missingIncludeSystem \
	--template='{file}:{line}: {id}: {message}' $(filter-out -std=c11,$(LINT_FLAGS))
build/lint/firmware/port/linux/machine_file.ok: ANALYZER_FLAGS := -Wno-analyzer-file-leak -Wno-analyzer-malloc-leak

build/lint/%.ok: %.c $(HEADERS) .clang-tidy | $(GENERATED)
	@mkdir -p $(@D); echo "  LINT $<"
	$(Q)$(CC) $(CFLAGS) -fanalyzer $(ANALYZER_FLAGS) $(LINT_FLAGS) -c $< -o /dev/null
	$(Q)$(VENV)/bin/clang-tidy --quiet $< -- $(LINT_FLAGS) 2>$@.log || { cat $@.log; exit 1; }
	@touch $@

# MISRA's rules for each back end; num_f32.c is the one file that belongs to one of them.
MISRA_SOURCES := $(filter-out firmware/port/linux/%,$(LINT_SOURCES))
fix_NOT_MISRA := firmware/core/num_f32.c
build/lint/misra-%.ok: $(LINT_SOURCES) $(HEADERS) firmware/deviations.txt | $(GENERATED)
	@mkdir -p build/lint/cppcheck-$*; echo "  MISRA firmware ($*)"
	$(Q)$(CPPCHECK) --cppcheck-build-dir=build/lint/cppcheck-$* -D__arm__ $($*_FLAGS) --addon=misra --suppress='*:build/gen/*' \
	  $(filter-out $($*_NOT_MISRA),$(MISRA_SOURCES))
	@touch $@

build/lint/linux.ok: $(LINT_SOURCES) $(HEADERS) firmware/deviations.txt | $(GENERATED)
	@mkdir -p build/lint/cppcheck-linux; echo "  CPPCHECK firmware/port/linux"
	$(Q)$(CPPCHECK) --cppcheck-build-dir=build/lint/cppcheck-linux $(filter firmware/port/linux/%,$(LINT_SOURCES))
	@touch $@

lint-c: build/lint/misra-f32.ok build/lint/misra-fix.ok $(LINT_SOURCES:%.c=build/lint/%.ok) build/lint/linux.ok
	@for f in $$(grep -l NOLINT -r firmware --include='*.[ch]'); do grep -q "^# $${f#firmware/}, " firmware/deviations.txt || \
	  { echo "make: $$f has a NOLINT that firmware/deviations.txt does not justify"; exit 1; }; done
.PHONY: lint-c

# --- fuzzing --------------------------------------------------------------------------------------------------------------
# tests/fuzz/NAME.c with clang's libFuzzer; what is found goes to build/fuzz/NAME-crash-*, new inputs to build/fuzz/corpus (tests/fuzz/corpus.py).
# build/fuzz/asan: AddressSanitizer and UBSan; build/fuzz/ub: UBSan alone, nearly twice as fast.
FUZZERS  := can sdo slcan store
SECONDS  := 60
SEED     := 1
RUNS     := 100000000
FUZZ_SANITIZE_asan := -fsanitize=address,undefined -fno-sanitize-recover=all
FUZZ_SANITIZE_ub := -fsanitize=undefined -fno-sanitize-recover=all
# Without a call at each comparison, which would take half of the time: what the firmware compares with, the fuzzers know.
FUZZ_FLAGS = $(CFLAGS) $(f32_HOST) -Itests/fuzz $(INCLUDE) -Itests/unit -DKONTUR_BUILD_ID='"fuzz"' -DKONTUR_VERSION='"$(VERSION)"' \
	-fsanitize=fuzzer-no-link -fno-sanitize-coverage=trace-cmp,indirect-calls -Wno-unknown-attributes
FUZZ_SOURCES := $(SOURCES) firmware/port/slcan.c

# Its runtime library is a package of its own, which a machine with clang may lack.
build/clang.stamp:
	$(Q)$(call debian,echo 'int LLVMFuzzerTestOneInput(void) { return 0; }' | clang -fsanitize=fuzzer -fsanitize=address -x c - -o /dev/null,clang libclang-rt-dev)

define fuzzers
build/fuzz/$(1)/%.o: %.c | build/clang.stamp $(GENERATED)
	@mkdir -p $$(@D); echo "  CC  $$< (fuzz, $(1))"
	$(Q)clang $$(FUZZ_FLAGS) $$(FUZZ_SANITIZE_$(1)) -MMD -MP -c $$< -o $$@

# Of the library, a fuzzer gets what it uses: each edge that is there costs time after each input.
build/fuzz/$(1)/libkontur.a: $(FUZZ_SOURCES:%.c=build/fuzz/$(1)/%.o)
	@rm -f $$@
	$(Q)ar rcs $$@ $$^

build/fuzz/$(1)/%: build/fuzz/$(1)/tests/fuzz/%.o build/fuzz/$(1)/libkontur.a
	$(Q)clang $$(FUZZ_SANITIZE_$(1)) -fsanitize=fuzzer $$^ -lm -o $$@

-include $(FUZZ_SOURCES:%.c=build/fuzz/$(1)/%.d) $(FUZZERS:%=build/fuzz/$(1)/tests/fuzz/%.d)
endef
$(foreach s,asan ub,$(eval $(call fuzzers,$(s))))

fuzz: setup lib $(FUZZERS:%=build/fuzz/asan/%)  ## fuzz CAN, SDO, slcan, stored image and G-code, SECONDS=60 each, from SEED=1
	@$(foreach f,$(FUZZERS),mkdir -p build/fuzz/corpus/$(f); $(PY) tests/fuzz/corpus.py unpack $(f) build/fuzz/seeds/$(f) || exit 1; \
	  if build/fuzz/asan/$(f) -max_total_time=$(SECONDS) -seed=$(SEED) -print_final_stats=1 -artifact_prefix=build/fuzz/$(f)- \
	      -max_len=160 -len_control=0 -entropic=0 -detect_leaks=0 build/fuzz/corpus/$(f) build/fuzz/seeds/$(f) >build/fuzz/$(f).log 2>&1; \
	  then awk -v f=$(f) '/number_of_executed_units/ { n = $$2 } /average_exec_per_sec/ { s = $$2 } \
	    END { printf "%-6s %10d executions %8d a second, no finding\n", f, n, s }' build/fuzz/$(f).log; \
	  else tail -40 build/fuzz/$(f).log; echo "make: $(f): a finding; run it again: build/fuzz/asan/$(f) build/fuzz/$(f)-crash-..."; exit 1; fi;)
	@$(PY) tests/fuzz/gcode.py $(SECONDS) $(SEED)

fuzz-campaign: setup lib $(foreach s,asan ub,$(FUZZERS:%=build/fuzz/$(s)/%))  ## fuzz until RUNS=100000000 in all (hours), from SEED=1; goes on where it was
	@nice -n 19 $(PY) tests/fuzz/campaign.py $(RUNS) $(SEED)
.PHONY: fuzz fuzz-campaign

# --- branch coverage --------------------------------------------------------------------------------------------------
# Counts of an earlier run go first, for each program adds its own. Not counted: generated code, and what no C test links.
coverage: setup $(COVERAGE_PROGRAMS)  ## branches of the firmware that the C tests take, held: table, build/coverage/html/index.html
	@find build/coverage -name '*.gcda' -delete; mkdir -p build/coverage/html
	@printf '%s\n' $(COVERAGE_PROGRAMS) | xargs -P $(JOBS) -I{} sh -c '{} >{}.log 2>&1 || { echo "{} FAILED"; grep -v ":PASS$$" {}.log; exit 1; }'
	@$(VENV)/bin/gcovr --root . --filter firmware/ --merge-lines --json build/coverage/coverage.json \
	  --html-details build/coverage/html/index.html build/coverage
	@$(PY) tests/unit/check_coverage.py build/coverage/coverage.json tests/unit/uncovered.toml
.PHONY: coverage

# --- C tests ----------------------------------------------------------------------------------------------------------
build/unity/src/unity.c: tests/unit/unity.lock | $(VENV)/stamp
	@mkdir -p build/unity; echo "Fetching Unity (see $<)"
	$(Q)$(PY) -m pip download --quiet --disable-pip-version-check --no-deps --no-binary :all: --no-build-isolation --require-hashes -r $< -d build/unity
	$(Q)tar -xzf build/unity/pytest_unity-*.tar.gz -C build/unity --strip-components=3 --wildcards '*/vendor/unity/src' '*/vendor/unity/LICENSE.txt'
	@touch $@

# As a program without sanitizers, which has some minutes' work as it is
build/power_cut: tests/unit/test_power_cut.c build/coverage/unity.o $(call objects,build/lib,f32)
	$(Q)$(CC) $(CFLAGS) $(INCLUDE) $(TEST_INCLUDE) $(UNITY) -MMD -MP -MF $@.d $(filter %.c %.o,$^) -lm -o $@

power-cut: build/power_cut  ## the parameter store: power cut in every pair of operations (some minutes); make test has a part
	POWER_CUT=all build/power_cut
.PHONY: power-cut

build/unit/unity.o: UNITY_FLAGS := $(SANITIZE)
build/unit/unity.o build/coverage/unity.o: $(UNITY_DIR)/unity.c
	@mkdir -p $(@D)
	$(Q)$(CC) -std=c11 -O1 -g $(UNITY_FLAGS) $(UNITY) -c $< -o $@

TEST_DEPENDENCIES := $(foreach n,$(NUMS),$(patsubst %.o,%.d,$(call objects,build/unit,$(n))) $(PORT_SOURCES:%.c=build/unit/$(n)/%.d)) \
	$(CHIP_SOURCES:%.c=build/unit/f32/%.d) build/unit/f32/tests/golden/golden.d build/unit/fix/tests/golden/golden.d $(TEST_PROGRAMS:%=%.d)
-include $(LINUX:%.o=%.d) $(foreach n,$(NUMS),$(patsubst %.o,%.d,$(call objects,build/lib,$(n)))) $(IMAGE_OBJECTS:%.o=%.d) \
	$(TEST_DEPENDENCIES) $(TEST_DEPENDENCIES:build/unit/%=build/coverage/%) \
	$(foreach n,$(TARGETS),$(patsubst %.o,%.d,$(call target_objects,$(n)))) $(TARGET_TESTS:%=build/target/%.elf.d) \
	$(foreach p,hash bench_step bench_scope,$(TARGETS:%=build/target/%/$(p).elf.d)) \
	build/target/m4-f32/bench_port.elf.d $(DRIVERS:.o=.d) build/power_cut.d
