# SPDX-License-Identifier: Apache-2.0
# What a Python package holds that is compiled (pyproject.toml): the library in each numeric back end, and the process.
# A build tree has one back end, so each is built in a tree of its own, one after the other, as the presets host-f32,
# host-fix and host-chk do. The result is for any processor of this kind.
if(MSVC)
    message(FATAL_ERROR "The firmware is C11 with GNU attributes: set CC=clang or CC=gcc")
endif()
include(ExternalProject)
set(package ${CMAKE_BINARY_DIR}/package)
foreach(num IN ITEMS f32 fix chk)
    ExternalProject_Add(kontur_${num}
        SOURCE_DIR ${PROJECT_SOURCE_DIR}
        BINARY_DIR ${CMAKE_BINARY_DIR}/${num}
        CMAKE_ARGS -DCMAKE_C_COMPILER=${CMAKE_C_COMPILER} -DPython3_EXECUTABLE=${Python3_EXECUTABLE}
            -DCMAKE_OSX_ARCHITECTURES=${CMAKE_OSX_ARCHITECTURES}
            -DKONTUR_LIBRARY=ON -DKONTUR_NUM=${num} -DKONTUR_PORTABLE=ON -DKONTUR_LIBRARY_DIR=${package}
        BUILD_ALWAYS ON INSTALL_COMMAND "" USES_TERMINAL_CONFIGURE ON USES_TERMINAL_BUILD ON)
endforeach()
install(DIRECTORY ${package}/ DESTINATION kontur/lib USE_SOURCE_PERMISSIONS)
