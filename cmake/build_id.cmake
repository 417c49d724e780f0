# SPDX-License-Identifier: Apache-2.0
# The version of the source that is built, told by the drive (object build_id). It is asked for with each build, as it
# changes with each commit; only device.c is compiled again then.
cmake_minimum_required(VERSION 3.25)
set(header ${KONTUR_GEN}/build_id.h)
if(CMAKE_SCRIPT_MODE_FILE)
    execute_process(COMMAND git describe --always --dirty WORKING_DIRECTORY ${SOURCE_DIR}
        OUTPUT_VARIABLE id OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    if(NOT id)
        set(id unknown)
    endif()
    file(CONFIGURE OUTPUT ${header} CONTENT "#define KONTUR_BUILD_ID \"@id@\"\n" @ONLY)
else()
    add_custom_target(kontur_build_id BYPRODUCTS ${header} COMMENT "" VERBATIM
        COMMAND ${CMAKE_COMMAND} -DSOURCE_DIR=${PROJECT_SOURCE_DIR} -DKONTUR_GEN=${KONTUR_GEN}
            -P ${CMAKE_CURRENT_LIST_FILE})
    add_dependencies(kontur_device kontur_build_id)
    set_source_files_properties(device.c PROPERTIES
        COMPILE_OPTIONS "-include;${header}" COMPILE_DEFINITIONS "KONTUR_VERSION=\"${PROJECT_VERSION}\"")
endif()
