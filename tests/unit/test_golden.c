/* SPDX-License-Identifier: Apache-2.0 */
/* test_golden.c: the control core computes the golden vectors, bit by bit (tests/golden/README.md). */
#include "golden.h"

#include <stdio.h>

#include "unity.h"
#if defined(KONTUR_NUM_FIX)
#include "golden_fix.h"
#else
#include "golden_f32.h"
#endif

enum { WORDS = sizeof golden_words / sizeof golden_words[0] };

void setUp(void)
{
}
void tearDown(void)
{
}

static void compare(void *ctx, const char *vector, uint32_t word)
{
    uint32_t *count = ctx;
    char what[80];
    snprintf(what, sizeof what, "vector \"%s\", word %lu", vector, (unsigned long)*count);
    TEST_ASSERT_TRUE_MESSAGE(*count < WORDS, what);
    TEST_ASSERT_EQUAL_HEX32_MESSAGE(golden_words[*count], word, what);
    ++*count;
}

static void test_every_word_is_the_one_written_down(void)
{
    uint32_t count = 0;
    golden_run(compare, &count);
    TEST_ASSERT_EQUAL_UINT32(WORDS, count);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_every_word_is_the_one_written_down);
    return UNITY_END();
}
