# SPDX-License-Identifier: Apache-2.0
# Unity, the C test framework, is fetched as tests/unit/unity.lock says, once for all trees.
set(lock ${PROJECT_SOURCE_DIR}/tests/unit/unity.lock)
file(SHA256 ${lock} hash)
string(SUBSTRING ${hash} 0 12 hash)
set(unity ${PROJECT_SOURCE_DIR}/build/unity-${hash})
if(NOT EXISTS ${unity}/src/unity.c)
    message(STATUS "Fetching Unity (see tests/unit/unity.lock)")
    execute_process(COMMAND_ERROR_IS_FATAL ANY
        COMMAND ${Python3_EXECUTABLE} -m pip download --quiet --disable-pip-version-check --no-deps --no-binary :all:
            --no-build-isolation --require-hashes -r ${lock} -d ${unity})
    file(GLOB package ${unity}/pytest_unity-*.tar.gz)
    file(ARCHIVE_EXTRACT INPUT ${package} DESTINATION ${unity} PATTERNS */vendor/unity/src/* */vendor/unity/LICENSE.txt)
    file(GLOB unpacked ${unity}/*/vendor/unity)
    file(COPY ${unpacked}/ DESTINATION ${unity})
endif()

add_library(unity OBJECT ${unity}/src/unity.c)
target_include_directories(unity SYSTEM PUBLIC ${unity}/src)
target_compile_definitions(unity PUBLIC UNITY_INCLUDE_DOUBLE UNITY_SUPPORT_64)
