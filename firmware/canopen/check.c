/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/check.h"

#include <stddef.h>

#include "canopen/frame.h"
#include "canopen/pdo.h"

/* Restricted CAN identifiers (CiA 301): other services use them. */
static bool is_restricted(uint32_t id)
{
    return id < 0x80 || (id > 0x100 && id <= 0x180) || (id > 0x580 && id < 0x600) || (id > 0x600 && id < 0x680) ||
           (id >= 0x6E0);
}

/* Besides the bits `flags`, a COB-ID has nothing but an 11-bit identifier. That of a service in use cannot change. */
static uint32_t check_cob_id(uint32_t now, uint32_t value, uint32_t flags)
{
    const bool used = !(value & COB_UNUSED), was_used = !(now & COB_UNUSED);
    if ((value & ~(flags | COB_UNUSED | COB_ID_MASK)) != 0 || (used && is_restricted(value & COB_ID_MASK)) ||
        (used && was_used && ((now ^ value) & COB_ID_MASK) != 0)) {
        return SDO_ABORT_VALUE;
    }
    return SDO_OK;
}

static uint32_t check_server_2(const struct od_data *od, const struct od_entry *entry, uint32_t value)
{
    const bool is_id = entry->sub != SUB_SDO_SERVER_2_CLIENT;
    return is_id ? check_cob_id((uint32_t)od_read(od, entry), value, 0) : SDO_OK;
}

/* Bit 31 of the SYNC's COB-ID has no meaning; bit 30 would make this node its producer. */
static uint32_t check_sync_cob_id(uint32_t value)
{
    const uint32_t cob_id = value & ~COB_UNUSED;
    return cob_id > COB_ID_MASK || is_restricted(cob_id) ? SDO_ABORT_VALUE : SDO_OK;
}

static uint32_t check_sync_overflow(const struct od_data *od, int64_t value)
{
    if (value == 1) {
        return SDO_ABORT_VALUE;
    }
    return od->sync_period != 0 ? SDO_ABORT_STATE : SDO_OK;
}

/* The sub-indices of RPDOs are those of TPDOs, but for the last one. */
static uint32_t check_communication(const struct od_data *od, const struct od_entry *entry, uint32_t value)
{
    const uint32_t cob_id = (uint32_t)od_number(od, entry->index, SUB_TPDO1_COB_ID);
    switch (entry->sub) {
    case SUB_TPDO1_COB_ID: return check_cob_id(cob_id, value, COB_NO_RTR);
    case SUB_TPDO1_TYPE: return value > PDO_SYNC_MAX && value < PDO_EVENT ? SDO_ABORT_VALUE : SDO_OK;
    case SUB_TPDO1_EVENT_MS: return SDO_OK;
    default: return (cob_id & COB_UNUSED) ? SDO_OK : SDO_ABORT_STATE;
    }
}

/* Whether entries 1..count can be mapped together. */
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
    const bool transmit = entry->index >= OBJ_TPDO1_MAP;
    const unsigned communication = entry->index - (unsigned)(OBJ_RPDO1_MAP - OBJ_RPDO1);
    const bool used = !(od_number(od, communication, SUB_TPDO1_COB_ID) & COB_UNUSED);
    uint32_t code = SDO_OK;
    if (used || (entry->sub != 0 && od_number(od, entry->index, 0) != 0)) {
        return SDO_ABORT_STATE;
    }
    if (entry->sub == 0) {
        return check_mapping_count(od, entry->index, transmit, value);
    }
    if (value != 0) { /* 0: the entry is empty */
        (void)co_pdo_mappable(value, transmit, &code);
    }
    return code;
}

static bool is_mapping(uint16_t index)
{
    return (index >= OBJ_RPDO1_MAP && index < OBJ_TPDO1) || index >= OBJ_TPDO1_MAP;
}

/* A PDO is switched on or off, and nothing else changes. Not RPDO1, which carries stops. */
static bool switches_pdo(const struct od_data *od, const struct od_entry *entry, uint32_t value)
{
    return !is_mapping(entry->index) && entry->index != OBJ_RPDO1 && entry->sub == SUB_RPDO1_COB_ID &&
           ((value ^ (uint32_t)od_read(od, entry)) & ~(COB_UNUSED | COB_NO_RTR)) == 0;
}

static uint32_t check_pdo(const struct od_data *od, bool operational, const struct od_entry *entry, uint32_t value)
{
    if (operational && !switches_pdo(od, entry, value)) {
        return SDO_ABORT_STATE;
    }
    return is_mapping(entry->index) ? check_mapping(od, entry, value) : check_communication(od, entry, value);
}

uint32_t co_check_write(const struct od_data *od, bool operational, const struct od_entry *entry, int64_t value)
{
    switch (entry->index) {
    case OBJ_ERROR_HISTORY: return value == 0 ? SDO_OK : SDO_ABORT_VALUE;
    case OBJ_SYNC_COB_ID: return check_sync_cob_id((uint32_t)value);
    case OBJ_EMCY_COB_ID: return check_cob_id(od->emcy_cob_id, (uint32_t)value, 0);
    case OBJ_SDO_SERVER_2: return check_server_2(od, entry, (uint32_t)value);
    case OBJ_SYNC_OVERFLOW: return check_sync_overflow(od, value);
    default: break;
    }
    const bool of_pdo = entry->index >= OD_PDO_FIRST && entry->index <= OD_PDO_LAST;
    return of_pdo ? check_pdo(od, operational, entry, (uint32_t)value) : SDO_OK;
}
