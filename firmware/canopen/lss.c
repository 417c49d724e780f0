/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/lss.h"

#include <stddef.h>

#include "canopen/node.h"

/* Command specifiers (CiA 305) */
enum {
    SWITCH_GLOBAL = 0x04,
    CONFIGURE_NODE_ID = 0x11,
    CONFIGURE_BIT_TIMING = 0x13,
    ACTIVATE_BIT_TIMING = 0x15,
    STORE = 0x17,
    SELECT_VENDOR = 0x40, /* .. product, revision, serial */
    SELECT_SERIAL = 0x43,
    SELECTED = 0x44,
    IDENTIFY_VENDOR = 0x46, /* .. product, revision low and high, serial low and high */
    IDENTIFY_SERIAL_HIGH = 0x4B,
    IDENTIFY_UNCONFIGURED = 0x4C,
    IDENTIFIED = 0x4F,
    IDENTIFIED_UNCONFIGURED = 0x50,
    FASTSCAN = 0x51,
    INQUIRE_VENDOR = 0x5A, /* .. product, revision, serial */
    INQUIRE_SERIAL = 0x5D,
    INQUIRE_NODE_ID = 0x5E,
};
enum { ERROR_NONE = 0, ERROR_RANGE = 1, ERROR_STORE_ACCESS = 2 };
enum { FASTSCAN_ALL = 128, PARTS = 4 };

/* Part 0..3 of the address: vendor, product code, revision, serial number */
static uint32_t address(const struct co_node *node, unsigned part)
{
    return (uint32_t)od_number(node->config.od, 0x1018, part + 1);
}

static void respond(struct co_node *node, uint8_t command, uint32_t value, uint8_t bytes)
{
    struct can_frame frame = {.id = CO_LSS_RESPONSE, .len = 8, .data = {command}};
    co_put(&frame.data[1], value, bytes);
    co_send(node, &frame);
}

static bool unconfigured(const struct co_node *node)
{
    return node->config.node_id == OD_UNCONFIGURED;
}

static void leave(struct co_node *node)
{
    node->lss.configuring = false;
    if (unconfigured(node) && node->config.od->node.id != OD_UNCONFIGURED) {
        co_reset_communication(node);
    }
}

/* ---- in configuration state ---- */

static void configure_node_id(struct co_node *node, uint8_t id)
{
    const bool ok = (id >= 1 && id <= OD_NODE_MAX) || id == OD_UNCONFIGURED;
    if (ok) {
        node->config.od->node.id = id;
    }
    respond(node, CONFIGURE_NODE_ID, ok ? ERROR_NONE : ERROR_RANGE, 1);
}

static void configure_bit_timing(struct co_node *node, uint8_t table, uint8_t entry)
{
    static const uint16_t kbitps[] = {1000, 800, 500, 250, 125, 0, 50, 20, 10}; /* table 0 */
    const struct hal *hal = node->config.hal;
    const uint16_t rate = table == 0 && entry < sizeof kbitps / sizeof kbitps[0] ? kbitps[entry] : 0;
    const bool ok = rate != 0 && hal->can_bitrate(hal->ctx, rate, false);
    if (ok) {
        node->config.od->node.bitrate = rate;
    }
    respond(node, CONFIGURE_BIT_TIMING, ok ? ERROR_NONE : ERROR_RANGE, 1);
}

static void change_bitrate(struct co_node *node)
{
    const struct hal *hal = node->config.hal;
    const uint16_t rate = node->config.od->node.bitrate;
    if (rate != node->lss.bitrate && hal->can_bitrate(hal->ctx, rate, true)) {
        node->lss.bitrate = rate;
        node->tx_count = 0;
    }
}

static void activate_bit_timing(struct co_node *node, uint16_t delay_ms)
{
    node->lss.delay_ms = delay_ms;
    node->lss.silent_ms = 2u * delay_ms;
    if (delay_ms == 0) {
        change_bitrate(node);
    }
}

static void store(struct co_node *node)
{
    const struct co_hooks *hooks = &node->config.hooks;
    const bool ok = hooks->store_node != NULL && hooks->store_node(hooks->ctx);
    respond(node, STORE, ok ? ERROR_NONE : ERROR_STORE_ACCESS, 1);
}

static void configure(struct co_node *node, const uint8_t *request)
{
    const uint8_t command = request[0];
    switch (command) {
    case CONFIGURE_NODE_ID: configure_node_id(node, request[1]); break;
    case CONFIGURE_BIT_TIMING: configure_bit_timing(node, request[1], request[2]); break;
    case ACTIVATE_BIT_TIMING: activate_bit_timing(node, (uint16_t)co_get(&request[1], 2)); break;
    case STORE: store(node); break;
    case INQUIRE_NODE_ID: respond(node, command, node->config.node_id, 1); break;
    default:
        if (command >= INQUIRE_VENDOR && command <= INQUIRE_SERIAL) {
            respond(node, command, address(node, command - (unsigned)INQUIRE_VENDOR), 4);
        }
        break;
    }
}

/* ---- who is meant ---- */

/* The parts come in order; one that is another node's ends it. */
static void select_part(struct co_node *node, unsigned part, uint32_t value)
{
    struct co_lss *lss = &node->lss;
    const bool mine = (part == 0 || part == lss->selected) && value == address(node, part);
    lss->selected = (uint8_t)(mine ? part + 1 : 0);
    if (lss->selected == PARTS) {
        lss->selected = 0;
        lss->configuring = true;
        respond(node, SELECTED, 0, 0);
    }
}

static void identify(struct co_node *node, unsigned step, uint32_t value)
{
    static const struct {
        uint8_t part, low, high;
    } steps[] = {{0, 1, 1}, {1, 1, 1}, {2, 1, 0},
                 {2, 0, 1}, {3, 1, 0}, {3, 0, 1}}; /* `value` is a lower, an upper bound */
    struct co_lss *lss = &node->lss;
    const uint32_t own = address(node, steps[step].part);
    const bool mine = (step == 0 || step == lss->identified) && (steps[step].low == 0 || own >= value) &&
                      (steps[step].high == 0 || own <= value);
    lss->identified = (uint8_t)(mine ? step + 1 : 0);
    if (lss->identified == sizeof steps / sizeof steps[0]) {
        lss->identified = 0;
        respond(node, IDENTIFIED, 0, 0);
    }
}

/* Nodes without id whose part `sub` agrees with `number` from bit `check` on answer, all at once. One that has just been
 * given an id is in the configuration state until it takes it. */
static void fastscan(struct co_node *node, uint32_t number, uint8_t check, uint8_t sub, uint8_t next)
{
    struct co_lss *lss = &node->lss;
    if (!unconfigured(node) || lss->configuring) {
        return;
    }
    if (check == FASTSCAN_ALL) {
        lss->scanned = 0;
        respond(node, IDENTIFIED, 0, 0);
        return;
    }
    if (check >= 32 || next >= PARTS || sub != lss->scanned || ((number ^ address(node, sub)) >> check) != 0) {
        return;
    }
    if (check == 0) {
        lss->scanned = next;
        lss->configuring = next < sub; /* all parts are known */
    }
    respond(node, IDENTIFIED, 0, 0);
}

void co_lss_receive(struct co_node *node, const struct can_frame *frame)
{
    const uint8_t *request = frame->data;
    const uint8_t command = request[0];
    const uint32_t value = co_get(&request[1], 4);
    if (frame->len != 8) {
        return;
    }
    if (command == SWITCH_GLOBAL && request[1] == 0) {
        leave(node);
    } else if (command == SWITCH_GLOBAL && request[1] == 1) {
        node->lss.configuring = true;
    } else if (command >= SELECT_VENDOR && command <= SELECT_SERIAL) {
        select_part(node, command - (unsigned)SELECT_VENDOR, value);
    } else if (command >= IDENTIFY_VENDOR && command <= IDENTIFY_SERIAL_HIGH) {
        identify(node, command - (unsigned)IDENTIFY_VENDOR, value);
    } else if (command == IDENTIFY_UNCONFIGURED) {
        if (unconfigured(node)) {
            respond(node, IDENTIFIED_UNCONFIGURED, 0, 0);
        }
    } else if (command == FASTSCAN) {
        fastscan(node, value, request[5], request[6], request[7]);
    } else if (node->lss.configuring) {
        configure(node, request);
    }
}

void co_lss_tick_ms(struct co_node *node)
{
    struct co_lss *lss = &node->lss;
    if (lss->silent_ms != 0 && --lss->silent_ms == lss->delay_ms) {
        change_bitrate(node);
    }
}

void co_lss_reset(struct co_node *node)
{
    const uint16_t bitrate = node->lss.bitrate;
    node->lss = (struct co_lss){.bitrate = bitrate};
    change_bitrate(node);
}
