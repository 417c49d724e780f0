/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/lss.h"

#include <stddef.h>

#include "canopen/frame.h"

/* Command specifiers (CiA 305). Those of the parts of the address follow each other. */
enum {
    SWITCH_GLOBAL = 0x04,
    CONFIGURE_NODE_ID = 0x11,
    CONFIGURE_BIT_TIMING = 0x13,
    ACTIVATE_BIT_TIMING = 0x15,
    STORE = 0x17,
    SELECT_VENDOR = 0x40, /* then product, revision, serial number */
    SELECT_SERIAL = 0x43,
    SELECTED = 0x44,
    IDENTIFY_VENDOR = 0x46, /* then product, lowest and highest revision, lowest and highest serial number */
    IDENTIFY_SERIAL_HIGH = 0x4B,
    IDENTIFY_UNCONFIGURED = 0x4C,
    IDENTIFIED = 0x4F,
    IDENTIFIED_UNCONFIGURED = 0x50,
    FASTSCAN = 0x51,
    INQUIRE_VENDOR = 0x5A, /* then product, revision, serial number */
    INQUIRE_SERIAL = 0x5D,
    INQUIRE_NODE_ID = 0x5E,
};
/* Error code, and the specific error in the byte behind it */
enum { ERROR_NONE = 0, ERROR_RANGE = 1, ERROR_STORE_ACCESS = 2, ERROR_REFUSED = 0x01FF };
enum { FASTSCAN_ALL = 128, PARTS = 4 };

/* Part 0..3 of the address: vendor, product code, revision, serial number. */
static uint32_t address(const struct co_lss *lss, unsigned part)
{
    return (uint32_t)od_number(lss->od, OBJ_IDENTITY, SUB_IDENTITY_VENDOR_ID + part);
}

static void respond(struct co_lss *lss, uint8_t command, uint32_t value, uint8_t bytes)
{
    struct can_frame frame = {.id = CO_LSS_RESPONSE, .len = 8, .data = {command}};
    co_put(&frame.data[1], value, bytes);
    co_tx_send(lss->tx, &frame);
}

static bool is_unconfigured(const struct co_lss *lss)
{
    return lss->node_id == OD_UNCONFIGURED;
}

/* ---- bit rate ---- */

static void change_bitrate(struct co_lss *lss)
{
    const uint16_t rate = lss->od->node.bitrate;
    if (rate != lss->bitrate && lss->hal->can_bitrate(lss->hal->ctx, rate, true)) {
        lss->bitrate = rate;
        co_tx_clear(lss->tx);
    }
}

/* Send nothing for `ms` milliseconds. */
static void set_silence(struct co_lss *lss, uint32_t ms)
{
    lss->silent_ms = ms;
    lss->tx->muted = ms != 0;
}

/* ---- in the configuration state ---- */

/* Write 2001h as an SDO does: what the application does at a write is done, and what it refuses is refused. */
static unsigned write(struct co_lss *lss, unsigned sub, uint16_t value)
{
    uint32_t abort = 0;
    const struct od_entry *entry = od_find(OBJ_NODE, (uint8_t)sub, &abort);
    if (lss->hooks.before_write(lss->hooks.ctx, entry, value) != SDO_OK) {
        return ERROR_REFUSED;
    }
    od_write(lss->od, entry, value);
    lss->hooks.on_write(lss->hooks.ctx, entry);
    return ERROR_NONE;
}

static void configure_node_id(struct co_lss *lss, uint8_t id)
{
    const bool ok = (id >= 1 && id <= OD_NODE_MAX) || id == OD_UNCONFIGURED;
    respond(lss, CONFIGURE_NODE_ID, ok ? write(lss, SUB_NODE_ID, id) : ERROR_RANGE, 2);
}

static void configure_bit_timing(struct co_lss *lss, uint8_t table, uint8_t entry)
{
    static const uint16_t kbitps[] = {1000, 800, 500, 250, 125, 0, 50, 20, 10}; /* table 0 of CiA 305 */
    const uint16_t rate = table == 0 && entry < sizeof kbitps / sizeof kbitps[0] ? kbitps[entry] : 0;
    const bool ok = rate != 0 && lss->hal->can_bitrate(lss->hal->ctx, rate, false);
    respond(lss, CONFIGURE_BIT_TIMING, ok ? write(lss, SUB_NODE_BITRATE, rate) : ERROR_RANGE, 2);
}

/* The service has no answer. It is ignored while 2001h cannot be written. */
static void activate_bit_timing(struct co_lss *lss, uint16_t delay_ms)
{
    if (write(lss, SUB_NODE_BITRATE, lss->od->node.bitrate) != ERROR_NONE) {
        return;
    }
    lss->delay_ms = delay_ms;
    set_silence(lss, 2u * delay_ms);
    if (delay_ms == 0) {
        change_bitrate(lss);
    }
}

static void store(struct co_lss *lss)
{
    const bool ok = lss->hooks.store_node(lss->hooks.ctx);
    respond(lss, STORE, ok ? ERROR_NONE : ERROR_STORE_ACCESS, 1);
}

static void configure(struct co_lss *lss, const uint8_t *request)
{
    const uint8_t command = request[0];
    switch (command) {
    case CONFIGURE_NODE_ID: configure_node_id(lss, request[1]); break;
    case CONFIGURE_BIT_TIMING: configure_bit_timing(lss, request[1], request[2]); break;
    case ACTIVATE_BIT_TIMING: activate_bit_timing(lss, (uint16_t)co_get(&request[1], 2)); break;
    case STORE: store(lss); break;
    case INQUIRE_NODE_ID: respond(lss, command, lss->node_id, 1); break;
    default:
        if (command >= INQUIRE_VENDOR && command <= INQUIRE_SERIAL) {
            respond(lss, command, address(lss, command - (unsigned)INQUIRE_VENDOR), 4);
        }
        break;
    }
}

/* ---- which node is addressed ---- */

/* The parts come in order. One that is not this node's ends the selection. */
static void select_part(struct co_lss *lss, unsigned part, uint32_t value)
{
    const bool mine = (part == 0 || part == lss->selected) && value == address(lss, part);
    lss->selected = (uint8_t)(mine ? part + 1 : 0);
    if (lss->selected == PARTS) {
        lss->selected = 0;
        lss->configuring = true;
        respond(lss, SELECTED, 0, 0);
    }
}

static void identify(struct co_lss *lss, unsigned step, uint32_t value)
{
    /* Whether `value` is a lower bound of the part, and an upper one. */
    static const struct {
        uint8_t part, low, high;
    } steps[] = {{0, 1, 1}, {1, 1, 1}, {2, 1, 0}, {2, 0, 1}, {3, 1, 0}, {3, 0, 1}};
    const uint32_t own = address(lss, steps[step].part);
    const bool mine = (step == 0 || step == lss->identified) && (steps[step].low == 0 || own >= value) &&
                      (steps[step].high == 0 || own <= value);
    lss->identified = (uint8_t)(mine ? step + 1 : 0);
    if (lss->identified == sizeof steps / sizeof steps[0]) {
        lss->identified = 0;
        respond(lss, IDENTIFIED, 0, 0);
    }
}

/* All nodes without id answer, at once, whose part `sub` agrees with `number` from bit `check` on. A node that has just
 * been found is in the configuration state, and takes no part until it leaves that. */
static void fastscan(struct co_lss *lss, uint32_t number, uint8_t check, uint8_t sub, uint8_t next)
{
    if (!is_unconfigured(lss) || lss->configuring) {
        return;
    }
    if (check == FASTSCAN_ALL) {
        lss->scanned = 0;
        respond(lss, IDENTIFIED, 0, 0);
        return;
    }
    if (check >= 32 || next >= PARTS || sub != lss->scanned || ((number ^ address(lss, sub)) >> check) != 0) {
        return;
    }
    if (check == 0) {
        lss->scanned = next;
        lss->configuring = next < sub; /* the master knows all parts */
    }
    respond(lss, IDENTIFIED, 0, 0);
}

/* ---- all ---- */

bool co_lss_receive(struct co_lss *lss, const struct can_frame *frame)
{
    const uint8_t *request = frame->data;
    const uint8_t command = request[0];
    const uint32_t value = co_get(&request[1], 4);
    if (frame->len != 8) {
        return false;
    }
    if (command == SWITCH_GLOBAL && request[1] == 0) {
        lss->configuring = false;
        return is_unconfigured(lss) && lss->od->node.id != OD_UNCONFIGURED;
    }
    if (command == SWITCH_GLOBAL && request[1] == 1) {
        lss->configuring = true;
    } else if (command >= SELECT_VENDOR && command <= SELECT_SERIAL) {
        select_part(lss, command - (unsigned)SELECT_VENDOR, value);
    } else if (command >= IDENTIFY_VENDOR && command <= IDENTIFY_SERIAL_HIGH) {
        identify(lss, command - (unsigned)IDENTIFY_VENDOR, value);
    } else if (command == IDENTIFY_UNCONFIGURED) {
        if (is_unconfigured(lss)) {
            respond(lss, IDENTIFIED_UNCONFIGURED, 0, 0);
        }
    } else if (command == FASTSCAN) {
        fastscan(lss, value, request[5], request[6], request[7]);
    } else if (lss->configuring) {
        configure(lss, request);
    }
    return false;
}

void co_lss_tick_ms(struct co_lss *lss)
{
    if (lss->silent_ms == 0) {
        return;
    }
    set_silence(lss, lss->silent_ms - 1);
    if (lss->silent_ms == lss->delay_ms) {
        change_bitrate(lss);
    }
}

void co_lss_reset(struct co_lss *lss, uint8_t node_id)
{
    lss->node_id = node_id;
    lss->configuring = false;
    lss->selected = 0;
    lss->identified = 0;
    lss->scanned = 0;
    lss->delay_ms = 0;
    set_silence(lss, 0);
    change_bitrate(lss);
}

void co_lss_init(struct co_lss *lss, struct od_data *od, struct co_tx *tx, const struct hal *hal,
                 const struct co_lss_hooks *hooks)
{
    *lss = (struct co_lss){.od = od, .tx = tx, .hal = hal, .hooks = *hooks, .node_id = OD_UNCONFIGURED};
}
