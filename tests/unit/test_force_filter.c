/* SPDX-License-Identifier: Apache-2.0 */
/* test_force_filter.c: the second-order filters of the force. tests/host/test_oracle.py compares them with SciPy. */
#include "core/force_filter.h"

#include <math.h>

#include "num_test.h"
#include "unity.h"

#define RATE 10000u
static const double PI = 3.14159265358979323846;

static struct force_section_spec spec[FORCE_SECTIONS];
static struct force_filter_cfg cfg;
static struct force_filter_state state;

void setUp(void)
{
    for (unsigned n = 0; n < FORCE_SECTIONS; n++) {
        spec[n] = (struct force_section_spec){0, 100, 0, 700};
    }
    cfg = (struct force_filter_cfg){.on = false};
    force_filter_reset(&state, mk2(0, 0));
}

void tearDown(void)
{
}

static void design(int i)
{
    TEST_ASSERT_TRUE(force_filter_design(&cfg, i, spec, RATE));
}

/* The amplitude of x and y after the filters have settled on a sine of 100 N */
static void amplitude(double f_Hz, double *x, double *y)
{
    double s[2] = {0, 0}, c[2] = {0, 0};
    for (int k = 0; k < 20000; k++) {
        const double angle = 2 * PI * f_Hz / RATE * k;
        const vec2 out = force_filter_step(&cfg, &state, mk2(100 * sin(angle), 100 * sin(angle)));
        if (k >= 10000) {
            s[0] += val(out.x) * sin(angle) / 500000;
            c[0] += val(out.x) * cos(angle) / 500000;
            s[1] += val(out.y) * sin(angle) / 500000;
            c[1] += val(out.y) * cos(angle) / 500000;
        }
    }
    *x = hypot(s[0], c[0]);
    *y = hypot(s[1], c[1]);
}

static void test_notch_leaves_the_ratio_of_the_dampings_at_its_frequency(void)
{
    double x, y;
    spec[2] = (struct force_section_spec){170000, 70, 170000, 700};
    design(1);
    amplitude(170, &x, &y);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 1, x); /* it has no section */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 + HALF_STEPS(300), 0.1, y);
}

static void test_low_pass_has_its_quality_at_the_frequency_of_its_poles(void)
{
    const uint32_t mHz[] = {20000, 800000, 2400000, 2600000, 4500000};
    for (unsigned i = 0; i < 5; i++) {
        double x, y;
        setUp();
        spec[0] = (struct force_section_spec){0, 0, mHz[i], 800};
        design(0);
        amplitude(mHz[i] / 1000.0, &x, &y);
        TEST_ASSERT_DOUBLE_WITHIN(1e-4 + HALF_STEPS(300), 1 / 1.6, x);
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, 1, y);
    }
}

static void test_tangent_is_within_1e_5_up_to_the_highest_frequency(void)
{
    for (uint32_t mHz = 1000; mHz <= 4900000; mHz += 24495) {
        spec[0].pole_mHz = mHz;
        design(0);
        const double g = tan(PI * mHz / 1000.0 / RATE);
        TEST_ASSERT_DOUBLE_WITHIN(1e-5 * g + HALF_STEPS(1.01), g, val(cfg.section[0][0].g));
    }
}

static void test_a_constant_force_passes_unchanged_from_the_start(void)
{
    spec[0] = (struct force_section_spec){170000, 70, 170000, 700};
    spec[1] = (struct force_section_spec){0, 0, 500000, 700};
    spec[3] = (struct force_section_spec){60000, 1000, 300000, 1000};
    design(0);
    design(1);
    TEST_ASSERT_TRUE(cfg.on);
    TEST_ASSERT_EQUAL_UINT8(3, cfg.count[0]);
    force_filter_reset(&state, mk2(123.5, -77.25));
    for (int k = 0; k < 100; k++) {
        const vec2 out = force_filter_step(&cfg, &state, mk2(123.5, -77.25));
        TEST_ASSERT_EQUAL_DOUBLE(123.5, val(out.x));
        TEST_ASSERT_EQUAL_DOUBLE(-77.25, val(out.y));
    }
}

static void test_frequencies_are_from_1_hz_to_0_49_of_the_rate(void)
{
    const struct {
        uint32_t zero, pole;
        bool fits;
    } cases[] = {{0, 1000, true},     {0, 999, false},         {0, 4900000, true},       {0, 4900001, false},
                 {0, 5000000, false}, {4900000, 800000, true}, {4900001, 800000, false}, {999, 1000, false},
                 {1000, 1000, true},  {50000, 480000, true},   {50000, 510000, false},   {UINT32_MAX, 100000, false},
                 {50000, 0, true}};
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        setUp();
        spec[3] = (struct force_section_spec){cases[i].zero, 100, cases[i].pole, 700};
        TEST_ASSERT_EQUAL_MESSAGE(cases[i].fits, force_filter_design(&cfg, 1, spec, RATE), "case");
    }
    TEST_ASSERT_FALSE(cfg.on); /* of the last case: a section without poles is off */
}

static void test_number_of_sections_that_has_flipped_a_bit_stays_within_its_memory(void)
{
    design(0);
    cfg.count[0] = cfg.count[1] = 129;
    const vec2 out = force_filter_step(&cfg, &state, mk2(1, 2)); /* sections of zeros */
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.y));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_notch_leaves_the_ratio_of_the_dampings_at_its_frequency);
    RUN_TEST(test_low_pass_has_its_quality_at_the_frequency_of_its_poles);
    RUN_TEST(test_tangent_is_within_1e_5_up_to_the_highest_frequency);
    RUN_TEST(test_a_constant_force_passes_unchanged_from_the_start);
    RUN_TEST(test_frequencies_are_from_1_hz_to_0_49_of_the_rate);
    RUN_TEST(test_number_of_sections_that_has_flipped_a_bit_stays_within_its_memory);
    return UNITY_END();
}
