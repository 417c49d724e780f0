/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/telemetry_counts.h"

int32_t telemetry_counts(num x, int32_t scale)
{
    return n_to_scaled(x, scale);
}
