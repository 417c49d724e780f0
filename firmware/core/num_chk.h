/* SPDX-License-Identifier: Apache-2.0 */
/* num_chk.h: the checking back end of num.h, fixed point with a shadow in double beside each value.
 *
 * Every operation computes both. It ends the program (chk_fail) with file and line where
 * - the result leaves the range of fixed point, which would saturate silently,
 * - value and shadow differ in sign, and by more than CHK_ABS, or
 * - they differ by more than CHK_ABS + CHK_REL of the result; of a sum or difference, CHK_REL of its terms.
 * The bounds are wide, since they are to find errors of the program: where a path leaves standstill, the rates of its
 * direction (4) have two digits only. tests/unit/test_closed_loop.c asserts how precise contour error and force are.
 *
 * A comparison compares the values, so that value and shadow take the same branch. Positions (pos_t) have no shadow:
 * pos_sub() starts a new one.
 *
 * Context: tests and the simulator in a host process, never on
 * a chip. It needs C11 with double. Only num.h includes it.
 */
#ifndef KONTUR_NUM_CHK_H
#define KONTUR_NUM_CHK_H
#include <math.h>

#include "core/fix.h"

typedef struct {
    int32_t v;
    double d;
} num;

typedef struct {
    int64_t v;
    double d;
} acc_t;

#define NUM_NAME "chk"
#define CHK_ABS 0.1
#define CHK_REL 1e-2
#define CHK_MAX 4096.0

/* The program that links this supplies it (sim/chk_fail.c): it prints a message and ends the program. */
_Noreturn void chk_fail(const char *what, const char *file, int line, double value, double shadow);

/* v with shadow d, checked. The relative bound is CHK_REL of `scale`. */
static inline num chk(int32_t v, double d, double scale, const char *file, int line)
{
    const double value = v / 524288.0;
    const double error = fabs(value - d);
    if (!(fabs(d) < CHK_MAX)) {
        chk_fail("overflow", file, line, value, d);
    }
    if (value * d < 0.0 && error > CHK_ABS) {
        chk_fail("lost sign", file, line, value, d);
    }
    if (error > CHK_ABS + CHK_REL * scale) {
        chk_fail("error beyond bound", file, line, value, d);
    }
    return (num){v, d};
}

static inline acc_t chk_acc(int64_t v, double d, const char *file, int line)
{
    const num x = chk(fix_acc_to(v), d, fabs(d), file, line);
    return (acc_t){v, x.d};
}

#define NUM(c) ((num){FIX(c), (c)})
#define n_add(a, b) chk_add((a), (b), __FILE__, __LINE__)
#define n_sub(a, b) chk_sub((a), (b), __FILE__, __LINE__)
#define n_mul(a, b) chk_mul((a), (b), __FILE__, __LINE__)
#define n_div(a, b) chk_div((a), (b), __FILE__, __LINE__)
#define NUM_MAD
#define n_mad(a, b, c) n_add((a), n_mul((b), (c)))
#define n_msub(a, b, c) n_sub((a), n_mul((b), (c)))
#define n_sqrt(a) chk_sqrt((a), __FILE__, __LINE__)
#define n_hypot(a, b) chk_hypot((a), (b), __FILE__, __LINE__)
#define n_ratio(n, d) chk_ratio((n), (d), __FILE__, __LINE__)
#define pos_sub(a, b) chk_pos_sub((a), (b), __FILE__, __LINE__)
#define acc_mad(a, x, y) chk_acc_mad((a), (x), (y), __FILE__, __LINE__)

static inline num chk_add(num a, num b, const char *file, int line)
{
    return chk(fix_add(a.v, b.v), a.d + b.d, fabs(a.d) + fabs(b.d), file, line);
}

static inline num chk_sub(num a, num b, const char *file, int line)
{
    return chk(fix_sub(a.v, b.v), a.d - b.d, fabs(a.d) + fabs(b.d), file, line);
}

static inline num chk_mul(num a, num b, const char *file, int line)
{
    return chk(fix_mul(a.v, b.v), a.d * b.d, fabs(a.d * b.d), file, line);
}

static inline num chk_div(num a, num b, const char *file, int line)
{
    return chk(fix_div(a.v, b.v), a.d / b.d, fabs(a.d / b.d), file, line);
}

static inline num chk_sqrt(num a, const char *file, int line)
{
    const double root = sqrt(a.d > 0.0 ? a.d : 0.0);
    return chk(fix_sqrt(a.v), root, root, file, line);
}

static inline num chk_hypot(num a, num b, const char *file, int line)
{
    const double length = sqrt(a.d * a.d + b.d * b.d);
    return chk(fix_hypot(a.v, b.v), length, length, file, line);
}

static inline num chk_ratio(int64_t n, int64_t d, const char *file, int line)
{
    const double ratio = (double)n / (double)d;
    return chk(fix_ratio(n, d), ratio, fabs(ratio), file, line);
}

static inline num chk_pos_sub(pos_t a, pos_t b, const char *file, int line)
{
    const double um = (double)(a - b) / 65536000.0;
    return chk(fix_pos_sub(a, b), um, fabs(um), file, line);
}

static inline acc_t chk_acc_mad(acc_t a, num x, num y, const char *file, int line)
{
    const double step = x.d * y.d / ACC_GAIN;
    return chk_acc(fix_acc_mad(a.v, x.v, y.v), a.d + step, file, line);
}

static inline num n_neg(num a)
{
    return (num){fix_neg(a.v), -a.d};
}

static inline num n_state(num a)
{
    return (num){a.v, a.v / 524288.0};
}

static inline uint32_t n_word(num a)
{
    return (uint32_t)a.v;
}

static inline num n_of_word(uint32_t word)
{
    return (num){(int32_t)word, (int32_t)word / 524288.0};
}

static inline bool n_lt(num a, num b)
{
    return a.v < b.v;
}

static inline int64_t n_to_q32(num x)
{
    return fix_to_q32(x.v);
}

static inline int32_t n_to_scaled(num x, int32_t k)
{
    return fix_to_scaled(x.v, k);
}

static inline pos_t pos_add(pos_t p, num x)
{
    return fix_pos_add(p, x.v);
}

static inline acc_t acc_from(num x)
{
    return (acc_t){fix_acc_from(x.v), x.d};
}

static inline acc_t acc_state(acc_t a)
{
    return (acc_t){a.v, (double)a.v * 0x1p-48};
}

static inline num acc_to(acc_t a)
{
    return (num){fix_acc_to(a.v), a.d};
}
#endif
