/* SPDX-License-Identifier: Apache-2.0 */
#include "supervision/fault.h"

enum fault_reaction fault_reaction(const struct od_data *od, enum fault f)
{
    const enum fault_reaction r =
        f == FAULT_TUNNEL ? (enum fault_reaction)od->tunnel.reaction : (enum fault_reaction)fault_table[f].reaction;
    const bool off_at_once = od->axis[0].quick_stop_option == 0 || od->axis[1].quick_stop_option == 0;
    return r != REACT_QUICK_STOP ? r : off_at_once ? REACT_DISABLE : REACT_PATH_STOP;
}

uint32_t fault_mask(const struct od_data *od, enum fault_reaction reaction)
{
    uint32_t mask = 0;
    for (unsigned f = 0; f < FAULTS; f++) {
        mask |= fault_reaction(od, (enum fault)f) == reaction ? FAULT_BIT(f) : 0u;
    }
    return mask;
}
