/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/check.h"

#include <stddef.h>

#include "canopen/node.h"

/* CiA 301, table of restricted identifiers: those that other services use. */
static bool is_restricted(uint32_t id)
{
    return id < 0x80 || (id > 0x100 && id <= 0x180) || (id > 0x580 && id < 0x600) || (id > 0x600 && id < 0x680) ||
           (id >= 0x6E0);
}

/* Besides `flags`, nothing but an 11-bit identifier; the one of a service that is in use cannot change. */
static uint32_t check_cob_id(uint32_t now, uint32_t value, uint32_t flags)
{
    const bool used = !(value & COB_UNUSED), was_used = !(now & COB_UNUSED);
    if ((value & ~(flags | COB_UNUSED | COB_ID_MASK)) != 0 || (used && is_restricted(value & COB_ID_MASK)) ||
        (used && was_used && ((now ^ value) & COB_ID_MASK) != 0)) {
        return SDO_ABORT_VALUE;
    }
    return SDO_OK;
}

/* Bit 31 of the SYNC's identifier has no meaning; bit 30 would make this device its producer. */
static uint32_t check_sync_cob_id(uint32_t value)
{
    const uint32_t cob = value & ~COB_UNUSED;
    return cob > COB_ID_MASK || is_restricted(cob) ? SDO_ABORT_VALUE : SDO_OK;
}

static uint32_t check_sync_overflow(const struct od_data *od, int64_t value)
{
    if (value == 1) {
        return SDO_ABORT_VALUE;
    }
    return od->sync_period != 0 ? SDO_ABORT_STATE : SDO_OK;
}

static uint32_t check_communication(const struct od_data *od, const struct od_entry *entry, uint32_t value)
{
    const uint32_t cob = (uint32_t)od_number(od, entry->index, 1);
    switch (entry->sub) {
    case 1: return check_cob_id(cob, value, COB_NO_RTR);
    case 2: return value > PDO_SYNC_MAX && value < PDO_EVENT ? SDO_ABORT_VALUE : SDO_OK;
    case 5: return SDO_OK;
    default: return (cob & COB_UNUSED) ? SDO_OK : SDO_ABORT_STATE;
    }
}

/* Entries 1..count together */
static uint32_t check_mapping_count(const struct od_data *od, uint16_t index, bool transmit, unsigned count)
{
    unsigned bytes = 0;
    for (unsigned i = 1; i <= count; i++) {
        uint32_t code = SDO_OK;
        const struct od_entry *mapped = co_pdo_mappable((uint32_t)od_number(od, index, i), transmit, &code);
        if (mapped == NULL) {
            return code;
        }
        bytes += od_size(mapped);
    }
    return bytes > 8 ? SDO_ABORT_PDO_LENGTH : SDO_OK;
}

static uint32_t check_mapping(const struct od_data *od, const struct od_entry *entry, uint32_t value)
{
    const bool transmit = entry->index >= 0x1A00, used = !(od_number(od, entry->index - 0x200u, 1) & COB_UNUSED);
    uint32_t code = SDO_OK;
    if (used || (entry->sub != 0 && od_number(od, entry->index, 0) != 0)) {
        return SDO_ABORT_STATE;
    }
    if (entry->sub == 0) {
        return check_mapping_count(od, entry->index, transmit, value);
    }
    if (value != 0) { /* 0: not filled */
        (void)co_pdo_mappable(value, transmit, &code);
    }
    return code;
}

uint32_t co_check_write(const struct co_node *node, const struct od_entry *entry, int64_t value)
{
    const struct od_data *od = node->config.od;
    switch (entry->index) {
    case 0x1003: return value == 0 ? SDO_OK : SDO_ABORT_VALUE;
    case 0x1005: return check_sync_cob_id((uint32_t)value);
    case 0x1014: return check_cob_id(od->emcy_cob_id, (uint32_t)value, 0);
    case 0x1019: return check_sync_overflow(od, value);
    default: break;
    }
    if (entry->index < 0x1400 || entry->index >= 0x1C00) {
        return SDO_OK;
    }
    if (node->state == CO_OPERATIONAL) {
        return SDO_ABORT_STATE;
    }
    const bool mapping = (entry->index & 0x0200u) != 0;
    return mapping ? check_mapping(od, entry, (uint32_t)value) : check_communication(od, entry, (uint32_t)value);
}
