# SPDX-License-Identifier: Apache-2.0
# Toolchain file: Arm's GCC for a Cortex-M, whose programs run in QEMU with output and exit code by semihosting.
# KONTUR_CPU: m4 (Cortex-M4F, STM32F405) or m3 (Cortex-M3, STM32F205; no FPU).
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES KONTUR_CPU)
set(CMAKE_EXECUTABLE_SUFFIX_C .elf)

set(KONTUR_CPU m4 CACHE STRING "Processor: m4, m3")
if(KONTUR_CPU STREQUAL "m4")
    set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard")
    set(machine netduinoplus2)
elseif(KONTUR_CPU STREQUAL "m3")
    set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-m3 -mthumb")
    set(machine netduino2)
else()
    message(FATAL_ERROR "KONTUR_CPU=${KONTUR_CPU}: m4 or m3")
endif()

set(CMAKE_CROSSCOMPILING_EMULATOR
    qemu-system-arm -display none -monitor none -serial none -icount shift=0,sleep=off
    -semihosting-config enable=on,target=native -machine ${machine} -kernel)
