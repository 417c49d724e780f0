/* SPDX-License-Identifier: Apache-2.0 */
/* unity.h: the assertions of Unity that the rigs of tests/unit use. In a fuzzer an assertion that fails is a crash. */
#ifndef FUZZ_UNITY_H
#define FUZZ_UNITY_H
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TEST_ASSERT_TRUE_MESSAGE(condition, message)                                                                   \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, message);                                               \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)
#define TEST_ASSERT_TRUE(condition) TEST_ASSERT_TRUE_MESSAGE(condition, #condition)
#define TEST_ASSERT_FALSE(condition) TEST_ASSERT_TRUE_MESSAGE(!(condition), "not: " #condition)
#define TEST_ASSERT_NULL(pointer) TEST_ASSERT_TRUE_MESSAGE((pointer) == NULL, #pointer " is NULL")
#define TEST_ASSERT_NOT_NULL(pointer) TEST_ASSERT_TRUE_MESSAGE((pointer) != NULL, #pointer " is not NULL")
#define TEST_ASSERT_EQUAL(expected, actual) TEST_ASSERT_TRUE_MESSAGE((expected) == (actual), #actual " is " #expected)
#define TEST_ASSERT_EQUAL_UINT32_MESSAGE(expected, actual, message)                                                    \
    TEST_ASSERT_TRUE_MESSAGE((expected) == (actual), message)
#define TEST_ASSERT_EQUAL_STRING(expected, actual) TEST_ASSERT_TRUE_MESSAGE(strcmp(expected, actual) == 0, #actual)
#define TEST_ASSERT_EQUAL_UINT TEST_ASSERT_EQUAL
#define TEST_ASSERT_EQUAL_HEX8 TEST_ASSERT_EQUAL
#define TEST_ASSERT_EQUAL_HEX16 TEST_ASSERT_EQUAL
#define TEST_ASSERT_EQUAL_HEX32 TEST_ASSERT_EQUAL
#define TEST_ASSERT_NOT_EQUAL_HEX8(expected, actual) TEST_ASSERT_TRUE_MESSAGE((expected) != (actual), #actual)
#endif
