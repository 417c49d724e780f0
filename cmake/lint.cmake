# SPDX-License-Identifier: Apache-2.0
# To compile a tree with KONTUR_LINT is the check by gcc's analyser and by clang-tidy (.clang-tidy), as CMakePresets.json
# says. Here are the other ones: cppcheck, with the rules of MISRA C:2012 for what is in a drive, and clang-format.
# firmware/deviations.txt holds the rules that are not followed, and why.
get_filename_component(bin ${Python3_EXECUTABLE} DIRECTORY)
find_program(KONTUR_CPPCHECK cppcheck HINTS ${bin} REQUIRED)
find_program(KONTUR_CLANG_FORMAT clang-format HINTS ${bin} REQUIRED)
file(GLOB_RECURSE firmware_code CONFIGURE_DEPENDS firmware/*.[ch])
file(GLOB_RECURSE other_code CONFIGURE_DEPENDS sim/*.[ch] tests/*.[ch])
list(FILTER other_code EXCLUDE REGEX "/golden_(f32|fix)\\.h$")  # tables, made by write_golden

# Of what is generated clang-tidy looks at one check alone, for it wants one.
file(WRITE ${CMAKE_BINARY_DIR}/gen/.clang-tidy "Checks: '-*,misc-static-assert'\n")

# kontur_check(NAME OF FILE ... COMMAND ...): a target that runs the command again when a file has changed.
function(kontur_check name)
    cmake_parse_arguments(PARSE_ARGV 1 check "" "" "OF;COMMAND")
    add_custom_command(OUTPUT ${name}.ok
        COMMAND ${check_COMMAND}
        COMMAND ${CMAKE_COMMAND} -E touch ${CMAKE_CURRENT_BINARY_DIR}/${name}.ok
        DEPENDS ${check_OF} kontur_generated
        WORKING_DIRECTORY ${PROJECT_SOURCE_DIR} COMMENT "Checking by ${name}" VERBATIM)
    add_custom_target(${name} ALL DEPENDS ${name}.ok)
endfunction()

function(kontur_cppcheck name)
    file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/cppcheck/${name})
    kontur_check(${name} OF ${firmware_code} firmware/deviations.txt COMMAND ${KONTUR_CPPCHECK} -q --error-exitcode=1
        --project=${CMAKE_BINARY_DIR}/compile_commands.json --cppcheck-build-dir=${CMAKE_BINARY_DIR}/cppcheck/${name}
        --std=c11 -D__GNUC__ --enable=warning,style,performance,portability
        --suppressions-list=firmware/deviations.txt --suppress=missingIncludeSystem --suppress=*:*/gen/*
        "--template={file}:{line}: {id}: {message}" -i sim ${ARGN})
endfunction()
kontur_cppcheck(misra-f32 --addon=misra -D__arm__ -i firmware/port/linux)
kontur_cppcheck(misra-fix --addon=misra -D__arm__ -i firmware/port/linux -DKONTUR_NUM_FIX -i firmware/core/num_f32.c)
kontur_cppcheck(cppcheck-linux --file-filter=firmware/port/linux/*)

string(REPLACE ";" "\n" files "${firmware_code};${other_code}")
file(CONFIGURE OUTPUT format.txt CONTENT "${files}\n")
kontur_check(format OF ${firmware_code} ${other_code} .clang-format
    COMMAND ${KONTUR_CLANG_FORMAT} --dry-run --Werror --files=${CMAKE_CURRENT_BINARY_DIR}/format.txt)
kontur_check(nolint OF ${firmware_code} firmware/deviations.txt COMMAND ${CMAKE_COMMAND} -P cmake/nolint.cmake)
