/* SPDX-License-Identifier: Apache-2.0 */
#include "supervision/fault.h"

enum { LOST_MASTER_POWER_OFF = 2, LOST_MASTER_QUICK_STOP }; /* 6007h; 1: path stop */

/* 6007h of both axes: the one that stops sooner */
static unsigned reaction_to_lost_master(const struct od_data *od)
{
    const int16_t x = od->axis[0].abort_connection_option;
    const int16_t y = od->axis[1].abort_connection_option;
    return x == LOST_MASTER_POWER_OFF || y == LOST_MASTER_POWER_OFF     ? REACT_DISABLE
           : x == LOST_MASTER_QUICK_STOP || y == LOST_MASTER_QUICK_STOP ? REACT_QUICK_STOP
                                                                        : REACT_PATH_STOP;
}

enum fault_reaction fault_reaction(const struct od_data *od, enum fault f)
{
    const unsigned option = f == FAULT_TUNNEL        ? od->tunnel.reaction
                            : f == FAULT_OSCILLATION ? od->oscillation.reaction
                            : f == FAULT_HEARTBEAT   ? reaction_to_lost_master(od)
                                                     : fault_table[f].reaction;
    const enum fault_reaction r = option == OSCILLATION_LOWER_GAINS ? REACT_WARN : (enum fault_reaction)option;
    const bool off_at_once =
        od->axis[0].fault_reaction_option == 0 || od->axis[1].fault_reaction_option == 0 ||
        (r == REACT_QUICK_STOP && (od->axis[0].quick_stop_option == 0 || od->axis[1].quick_stop_option == 0));
    const bool stops = r == REACT_QUICK_STOP || r == REACT_PATH_STOP;
    return !stops ? r : off_at_once ? REACT_DISABLE : REACT_PATH_STOP;
}

uint32_t fault_mask(const struct od_data *od, enum fault_reaction reaction)
{
    uint32_t mask = 0;
    for (unsigned f = 0; f < FAULTS; f++) {
        mask |= fault_reaction(od, (enum fault)f) == reaction ? FAULT_BIT(f) : 0u;
    }
    return mask;
}
