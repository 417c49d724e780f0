/* SPDX-License-Identifier: Apache-2.0 */
/* num_fix.h: the fixed-point back end of num.h. A build with it has no floating point. Only num.h includes it. */
#ifndef KONTUR_NUM_FIX_H
#define KONTUR_NUM_FIX_H
#include "core/fix.h"

typedef int32_t num;
typedef int64_t acc_t;
#define NUM_NAME "fix"
#define NUM(c) FIX(c)

#define n_add fix_add
#define n_sub fix_sub
#define n_neg fix_neg
#define n_mul fix_mul
#define n_div fix_div
#define n_lt fix_lt
#define n_sqrt fix_sqrt
#define n_hypot fix_hypot
#define n_ratio fix_ratio
#define n_to_q32 fix_to_q32
#define n_to_scaled fix_to_scaled
#define pos_sub fix_pos_sub
#define pos_add fix_pos_add
#define n_state(x) (x)
#define n_word(x) ((uint32_t)(x))
#define n_of_word(w) ((num)(w))
#define acc_state(a) (a)
#define acc_from fix_acc_from
#define acc_to fix_acc_to
#define acc_mad fix_acc_mad
#endif
