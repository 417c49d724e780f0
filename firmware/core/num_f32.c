/* SPDX-License-Identifier: Apache-2.0 */
#include "core/num.h"

#ifdef NUM_ABS
__attribute__((noinline)) num n_from_wide(int64_t i)
{
    /* Below 2^37, as far as 2 mm in a position: without the last six bits, and the bit before stands for all of these. At
     * least 26 are left, of which rounding takes 24: it goes where it would with all. */
    const int64_t most = i >> 6;
    if (most == (int32_t)most) {
        return (num)((int32_t)most | ((i & 63) != 0 ? 1 : 0)) * 64.0f;
    }
    /* 32 leading bits, and again the last of them for all that are cut off */
    const uint64_t size = i < 0 ? 0u - (uint64_t)i : (uint64_t)i;
    const uint32_t shift = (uint32_t)__builtin_clz((uint32_t)(size >> 32));
    const uint64_t left = size << shift;
    const uint32_t leading = (uint32_t)(left >> 32) | ((uint32_t)left != 0 ? 1u : 0u);
    const num x = (num)leading * n_from_bits((127u + 32u - shift) << 23);
    return i < 0 ? -x : x;
}

__attribute__((noinline)) int64_t n_to_wide(num x)
{
    const uint32_t bits = n_bits(x);
    const uint32_t exponent = (bits >> 23) & 0xFFu;
    const uint64_t mantissa = (bits & 0x7FFFFFu) | 0x800000u;
    if (exponent == 0xFFu && (bits & 0x7FFFFFu) != 0) { /* no number */
        return 0;
    }
    const uint32_t size = bits & 0x7FFFFFFFu;
    /* NOLINTNEXTLINE(clang-analyzer-core.BitwiseShift) */
    const int64_t whole = size > n_bits(4.0e18f) ? (int64_t)4.0e18f : (int64_t)(mantissa << (exponent - 150u));
    return (bits >> 31) != 0 ? -whole : whole;
}

__attribute__((noinline)) int32_t n_to_wide_scaled(num y)
{
    if (!(__builtin_fabsf(y) < 2147483648.0f)) {
        return y > 0.0f ? INT32_MAX : y < 0.0f ? INT32_MIN : 0;
    }
    const int32_t whole = (int32_t)y;
    const num rest = y - (num)whole; /* 0 or a half */
    return rest != 0.0f ? whole + whole % 2 : whole;
}
#else
typedef int num_f32_is_not_used; /* ISO C knows no empty translation unit */
#endif
