/* SPDX-License-Identifier: Apache-2.0 */
#include "supervision/fault.h"

enum fault_reaction fault_reaction(const struct od_data *od, enum fault f)
{
    const unsigned option = f == FAULT_TUNNEL        ? od->tunnel.reaction
                            : f == FAULT_OSCILLATION ? od->oscillation.reaction
                                                     : fault_table[f].reaction;
    const enum fault_reaction r = option == OSCILLATION_LOWER_GAINS ? REACT_WARN : (enum fault_reaction)option;
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
