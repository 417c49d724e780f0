/* SPDX-License-Identifier: Apache-2.0 */
/* num_f32.c: the rare conversions of num_f32.h, between float32 and integers of more than 32 bits. They are called
 * where a num is, in the servo tick and in the background loop. The other back ends leave this file empty. */
#include "core/num.h"

#ifdef NUM_ABS
__attribute__((noinline)) num n_from_wide(int64_t i)
{
    /* Below 2^37, which is 2 mm in a position: drop the last six bits, and set the bit before them if one of them is
     * set. At least 26 bits remain. Rounding keeps 24 of them, and so it gives the same result as with all bits. */
    const int64_t high = i >> 6;
    if (high == (int32_t)high) {
        return (num)((int32_t)high | ((i & 63) != 0 ? 1 : 0)) * 64.0f;
    }
    /* Keep the 32 leading bits, and set the last of them if one of the dropped bits is set. */
    const uint64_t size = i < 0 ? 0u - (uint64_t)i : (uint64_t)i;
    const uint32_t shift = (uint32_t)__builtin_clz((uint32_t)(size >> 32));
    const uint64_t aligned = size << shift;
    const uint32_t leading = (uint32_t)(aligned >> 32) | ((uint32_t)aligned != 0 ? 1u : 0u);
    const num x = (num)leading * n_from_bits((127u + 32u - shift) << 23);
    return i < 0 ? -x : x;
}

__attribute__((noinline)) int64_t n_to_wide(num x)
{
    const uint32_t bits = n_word(x);
    const uint32_t exponent = (bits >> 23) & 0xFFu;
    const uint64_t mantissa = (bits & 0x7FFFFFu) | 0x800000u;
    if (exponent == 0xFFu && (bits & 0x7FFFFFu) != 0) { /* NaN */
        return 0;
    }
    const uint32_t size = bits & 0x7FFFFFFFu;
    /* NOLINTNEXTLINE(clang-analyzer-core.BitwiseShift) */
    const int64_t integer = size > n_word(4.0e18f) ? (int64_t)4.0e18f : (int64_t)(mantissa << (exponent - 150u));
    return (bits >> 31) != 0 ? -integer : integer;
}

__attribute__((noinline)) int32_t n_to_wide_scaled(num y)
{
    if (!(__builtin_fabsf(y) < 2147483648.0f)) {
        return y > 0.0f ? INT32_MAX : y < 0.0f ? INT32_MIN : 0;
    }
    const int32_t integer = (int32_t)y;
    const num fraction = y - (num)integer; /* 0 or a half */
    return fraction != 0.0f ? integer + integer % 2 : integer;
}
#else
typedef int num_f32_is_not_used; /* ISO C forbids an empty translation unit */
#endif
