/* SPDX-License-Identifier: Apache-2.0 */
/* test_chk.c: the checking back end ends the program at errors that fixed point would make silently. The other
 * back ends have nothing to test. */
#include <setjmp.h>
#include <string.h>

#include "num_test.h"
#include "unity.h"

void setUp(void)
{
}
void tearDown(void)
{
}

#ifdef KONTUR_NUM_CHK
static jmp_buf back;
static const char *caught, *caught_file;
static int caught_line;

void chk_fail(const char *what, const char *file, int line, double value, double shadow)
{
    (void)value;
    (void)shadow;
    caught = what;
    caught_file = file;
    caught_line = line;
    longjmp(back, 1);
}

#define EXPECT_STOP(what, expression)                                                                                  \
    do {                                                                                                               \
        caught = "";                                                                                                   \
        const int line = __LINE__;                                                                                     \
        if (setjmp(back) == 0) {                                                                                       \
            (void)(expression);                                                                                        \
        }                                                                                                              \
        TEST_ASSERT_EQUAL_STRING(what, caught);                                                                        \
        TEST_ASSERT_EQUAL_INT(line, caught_line);                                                                      \
        TEST_ASSERT_NOT_NULL(strstr(caught_file, "test_chk.c"));                                                       \
    } while (0)

static void test_overflow_is_caught_where_it_happens(void)
{
    EXPECT_STOP("overflow", n_mul(mk(100), mk(41)));
    EXPECT_STOP("overflow", n_add(mk(4000), mk(97)));
    EXPECT_STOP("overflow", n_sub(mk(-4000), mk(97)));
    EXPECT_STOP("overflow", n_div(mk(5), mk(0.001)));
    EXPECT_STOP("overflow", n_hypot(mk(3000), mk(3000)));
    EXPECT_STOP("overflow", n_ratio(5000, 1));
    EXPECT_STOP("overflow", pos_sub(pos_from_nm(5000000), 0));
    EXPECT_STOP("overflow", acc_mad(acc_from(mk(4000)), mk(1024), mk(100)));
}

static void test_loss_of_precision_is_caught(void)
{
    /* A product below one step, 0.0005^2, is 0, and is then divided by a small number. */
    EXPECT_STOP("error beyond bound", n_div(n_mul(mk(0.0005), mk(0.0005)), mk(0.0000019)));
    /* A divisor of three steps has less than two digits. */
    EXPECT_STOP("error beyond bound", n_div(mk(0.02), n_mul(mk(0.002), mk(0.003))));
}

static void test_lost_sign_is_caught(void)
{
    const num planted = {FIX(0.2), -0.2};
    EXPECT_STOP("lost sign", n_mul(planted, mk(1)));
}

static void test_a_new_period_starts_new_shadows(void)
{
    const num planted = {FIX(2), 1.99};
    TEST_ASSERT_EQUAL_DOUBLE(2, n_state(planted).d);
    const acc_t slow = {(int64_t)2 << 48, 1.99};
    TEST_ASSERT_EQUAL_DOUBLE(2, acc_state(slow).d);
}
#endif

int main(void)
{
    UNITY_BEGIN();
#ifdef KONTUR_NUM_CHK
    RUN_TEST(test_overflow_is_caught_where_it_happens);
    RUN_TEST(test_loss_of_precision_is_caught);
    RUN_TEST(test_lost_sign_is_caught);
    RUN_TEST(test_a_new_period_starts_new_shadows);
#endif
    return UNITY_END();
}
