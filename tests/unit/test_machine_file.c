/* SPDX-License-Identifier: Apache-2.0 */
/* test_machine_file.c: the machine as plain text, with one clear message for each mistake. The module is part of this
 * program, so that a fatal message ends the test and not the process.
 */
#define _GNU_SOURCE /* strtok_r, fmemopen */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>

#include "port/linux/machine_file.c"
#include "unity.h"

static struct ks_machine machine;
static char message[256];
static jmp_buf end;

void setUp(void)
{
}

void tearDown(void)
{
}

void fatal(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    longjmp(end, 1);
}

static const char lines[] = "# a machine\n\n"
                            "mass_kg 88.08 97.9\n"
                            "viscous_Nspm 467.2 481.5\r\n"
                            "coulomb_N\t45.5 -47\n"
                            "breakaway 0 0\nstribeck_mps 0 0\nforce_limit_N 588 588\nforce_noise_N 0 0\n"
                            "current_lag_s 0 0\nencoder_m 7.5e-8 7.5e-8\ntravel_min_m -1 -2\ntravel_max_m 1 2\n"
                            "start_m 0.25 0\ndelay_periods 1\nsubsteps 4\n";

/* Read `from` and `more` as standard input. Returns the fatal message, or "". */
static const char *reads(const char *from, const char *more)
{
    char text[2048];
    FILE *before = stdin;
    (void)snprintf(text, sizeof text, "%s%s", from, more);
    message[0] = '\0';
    stdin = fmemopen(text, strlen(text), "r");
    TEST_ASSERT_NOT_NULL(stdin);
    if (setjmp(end) == 0) {
        machine_file_read("-", &machine);               /* it closes stdin */
    } else if (strstr(message, "is missing") == NULL) { /* a missing field is found after stdin is closed */
        (void)fclose(stdin);
    }
    stdin = before;
    return message;
}

static void test_fields_are_read_with_both_of_their_values(void)
{
    TEST_ASSERT_EQUAL_STRING("", reads(lines, ""));
    TEST_ASSERT_EQUAL_DOUBLE(88.08, machine.mass_kg[0]);
    TEST_ASSERT_EQUAL_DOUBLE(481.5, machine.viscous_Nspm[1]);
    TEST_ASSERT_EQUAL_DOUBLE(-47, machine.coulomb_N[1]);
    TEST_ASSERT_EQUAL_DOUBLE(7.5e-8, machine.encoder_m[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, machine.start_m[0]);
    TEST_ASSERT_EQUAL_INT32(4, machine.substeps);
    TEST_ASSERT_EQUAL_INT32(0, machine.schedule_count);
}

static void test_a_schedule_is_optional_and_has_up_to_sixteen_rows(void)
{
    TEST_ASSERT_EQUAL_STRING("", reads(lines, "schedule_count 2\nschedule_time_s 0 1.6\nschedule_scale 1 2\n"));
    TEST_ASSERT_EQUAL_INT32(2, machine.schedule_count);
    TEST_ASSERT_EQUAL_DOUBLE(1.6, machine.schedule_time_s[1]);
    TEST_ASSERT_EQUAL_STRING("", reads(lines, "schedule_time_s 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16\n"));
    TEST_ASSERT_EQUAL_STRING("machine -:17: schedule_time_s: 17: not a number that belongs here",
                             reads(lines, "schedule_time_s 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17\n"));
}

static void test_each_mistake_is_named_with_its_line(void)
{
    static const struct {
        const char *line, *message;
    } mistakes[] = {
        {"mas_kg 1 2\n", "machine -:17: mas_kg: no such field; `kontur sim` writes this file from a TOML file"},
        {"mass_kg 1\n", "machine -:17: mass_kg: has 1 of 2 values"},
        {"mass_kg 1 2 3\n", "machine -:17: mass_kg: 3: not a number that belongs here"},
        {"mass_kg 1 2x\n", "machine -:17: mass_kg: 2x: not a number that belongs here"},
        {"mass_kg 1 nan\n", "machine -:17: mass_kg: nan: not a number that belongs here"},
        {"mass_kg inf 1\n", "machine -:17: mass_kg: inf: not a number that belongs here"},
        {"substeps 1.5\n", "machine -:17: substeps: 1.5: not a number that belongs here"},
        {"substeps 2147483648\n", "machine -:17: substeps: 2147483648: not a number that belongs here"},
        {"substeps -2147483649\n", "machine -:17: substeps: -2147483649: not a number that belongs here"},
        {"substeps 99999999999999999999\n",
         "machine -:17: substeps: 99999999999999999999: not a number that belongs here"},
    };
    for (unsigned i = 0; i < sizeof mistakes / sizeof mistakes[0]; i++) {
        TEST_ASSERT_EQUAL_STRING(mistakes[i].message, reads(lines, mistakes[i].line));
    }
    TEST_ASSERT_EQUAL_STRING("machine -: mass_kg is missing", reads("substeps 1\n", ""));
}

static void test_a_file_that_is_not_there_is_named(void)
{
    if (setjmp(end) == 0) {
        machine_file_read("/nonexistent/machine", &machine);
        TEST_FAIL_MESSAGE("it was read");
    }
    TEST_ASSERT_EQUAL_STRING("machine /nonexistent/machine cannot be read: No such file or directory", message);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_fields_are_read_with_both_of_their_values);
    RUN_TEST(test_a_schedule_is_optional_and_has_up_to_sixteen_rows);
    RUN_TEST(test_each_mistake_is_named_with_its_line);
    RUN_TEST(test_a_file_that_is_not_there_is_named);
    return UNITY_END();
}
