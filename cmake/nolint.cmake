# SPDX-License-Identifier: Apache-2.0
# A finding that is switched off in the firmware's code (NOLINT) is justified in firmware/deviations.txt.
cmake_minimum_required(VERSION 3.25)
file(READ firmware/deviations.txt deviations)
file(GLOB_RECURSE code RELATIVE ${CMAKE_SOURCE_DIR}/firmware firmware/*.[ch])
foreach(name IN LISTS code)
    file(STRINGS firmware/${name} found REGEX NOLINT)
    string(FIND "${deviations}" "# ${name}, " reason)
    if(found AND reason EQUAL -1)
        message(SEND_ERROR "firmware/${name} has a NOLINT that firmware/deviations.txt does not justify")
    endif()
endforeach()
