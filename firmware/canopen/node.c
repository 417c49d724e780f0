/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/node.h"

#include <stddef.h>

#include "canopen/check.h"

enum { SERVICE_MASK = 0x780 }; /* of an identifier, without the node id */

/* ---- hooks of the services ---- */

static uint32_t before_write(void *ctx, const struct od_entry *entry, int64_t value)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    const uint32_t code = co_check_write(node->config.od, node->nmt.state == CO_OPERATIONAL, entry, value);
    if (code != SDO_OK || hooks->before_write == NULL) {
        return code;
    }
    return hooks->before_write(hooks->ctx, entry, value);
}

static void on_write(void *ctx, const struct od_entry *entry)
{
    struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    co_emcy_written(&node->emcy, entry->index);
    co_nmt_written(&node->nmt, entry->index);
    co_pdo_written(&node->pdo, entry->index);
    if (hooks->on_write != NULL) {
        hooks->on_write(hooks->ctx, entry);
    }
}

static void before_read(void *ctx, const struct od_entry *entry)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    if (hooks->before_read != NULL) {
        hooks->before_read(hooks->ctx, entry);
    }
}

static uint32_t domain_size(void *ctx, const struct od_entry *entry)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    return hooks->domain_size != NULL ? hooks->domain_size(hooks->ctx, entry) : 0u;
}

static bool domain_read(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    return hooks->domain_read(hooks->ctx, entry, at, to, count);
}

static uint32_t check_rpdo(void *ctx, const struct od_entry *entry, int64_t value)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    return hooks->check_rpdo != NULL ? hooks->check_rpdo(hooks->ctx, entry, value) : SDO_OK;
}

static void on_rpdo(void *ctx, unsigned number)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    if (hooks->on_rpdo != NULL) {
        hooks->on_rpdo(hooks->ctx, number);
    }
}

static void on_tpdo(void *ctx, unsigned number)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    if (hooks->on_tpdo != NULL) {
        hooks->on_tpdo(hooks->ctx, number);
    }
}

static bool store_node(void *ctx)
{
    const struct co_node *node = ctx;
    const struct co_hooks *hooks = &node->config.hooks;
    return hooks->store_node != NULL && hooks->store_node(hooks->ctx);
}

/* ---- NMT state ---- */

static void report_state(const struct co_node *node)
{
    const struct co_hooks *hooks = &node->config.hooks;
    if (hooks->on_nmt != NULL) {
        hooks->on_nmt(hooks->ctx, node->nmt.state);
    }
}

static void enter(struct co_node *node, enum co_state state)
{
    if (!co_nmt_enter(&node->nmt, state)) {
        return;
    }
    if (state == CO_OPERATIONAL) {
        co_pdo_start(&node->pdo);
    }
    report_state(node);
}

/* From initialising, which no frame can see, to pre-operational. A node without id stays in initialising. */
static void boot(struct co_node *node)
{
    co_nmt_reset(&node->nmt, node->config.node_id);
    co_sdo_reset(&node->sdo);
    co_sdo_reset(&node->second_sdo);
    co_emcy_refresh(&node->emcy);
    co_pdo_refresh(&node->pdo);
    co_lss_reset(&node->lss, node->config.node_id);
    if (node->config.node_id != OD_UNCONFIGURED) {
        co_nmt_send_boot_up(&node->nmt);
        enter(node, CO_PRE_OPERATIONAL);
    } else {
        report_state(node);
    }
}

static void reset(struct co_node *node, bool communication_only)
{
    const struct co_hooks *hooks = &node->config.hooks;
    if (hooks->load != NULL) {
        node->config.node_id = hooks->load(hooks->ctx, communication_only);
    } else {
        od_restore(node->config.od, node->config.node_id, OD_COMMUNICATION_FIRST,
                   communication_only ? OD_COMMUNICATION_LAST : OD_LAST);
    }
    if (!communication_only) {
        co_emcy_init(&node->emcy, node->config.od, &node->tx, &node->nmt);
    }
    if (hooks->on_reset != NULL) {
        hooks->on_reset(hooks->ctx, communication_only);
    }
    boot(node);
}

static void execute(struct co_node *node, enum co_nmt_command command)
{
    switch (command) {
    case CO_NMT_START: enter(node, CO_OPERATIONAL); break;
    case CO_NMT_STOP: enter(node, CO_STOPPED); break;
    case CO_NMT_ENTER_PRE_OPERATIONAL: enter(node, CO_PRE_OPERATIONAL); break;
    case CO_NMT_RESET_NODE: reset(node, false); break;
    case CO_NMT_RESET_COMMUNICATION: reset(node, true); break;
    default: break;
    }
}

/* 1029h:1 says which NMT state follows. The application learns of the loss first, since its stop may be gentler than
 * the one that it makes of the state. */
static void heartbeat_lost(struct co_node *node)
{
    enum { ENTER_PRE_OPERATIONAL = 0, ENTER_STOPPED = 2 };
    const struct co_hooks *hooks = &node->config.hooks;
    const uint8_t behaviour = node->config.od->error_behaviour.communication;
    if (hooks->on_heartbeat_lost != NULL) {
        hooks->on_heartbeat_lost(hooks->ctx);
    }
    if (behaviour == ENTER_STOPPED) {
        enter(node, CO_STOPPED);
    } else if (behaviour == ENTER_PRE_OPERATIONAL && node->nmt.state == CO_OPERATIONAL) {
        enter(node, CO_PRE_OPERATIONAL);
    }
}

/* ---- frames and time ---- */

void co_init(struct co_node *node, const struct co_config *config)
{
    const struct co_sdo_hooks sdo_hooks = {node, before_write, on_write, before_read, domain_size, domain_read};
    const struct co_pdo_hooks pdo_hooks = {
        .ctx = node, .check_rpdo = check_rpdo, .on_rpdo = on_rpdo, .on_tpdo = on_tpdo};
    const struct co_lss_hooks lss_hooks = {
        .ctx = node, .before_write = before_write, .on_write = on_write, .store_node = store_node};
    struct od_data *od = config->od;
    node->config = *config;
    co_tx_init(&node->tx, config->hal);
    co_nmt_init(&node->nmt, od, &node->tx);
    co_emcy_init(&node->emcy, od, &node->tx, &node->nmt);
    co_bus_state_init(&node->bus_state, od, config->hal, &node->emcy);
    co_pdo_init(&node->pdo, od, &node->tx, &node->emcy, &pdo_hooks);
    co_sdo_init(&node->sdo, od, &node->tx, &sdo_hooks);
    co_sdo_init(&node->second_sdo, od, &node->tx, &sdo_hooks);
    co_lss_init(&node->lss, od, &node->tx, config->hal, &lss_hooks);
    boot(node);
}

static void receive_sync(struct co_node *node, const struct can_frame *frame)
{
    const struct co_hooks *hooks = &node->config.hooks;
    if (co_pdo_sync(&node->pdo, frame) && hooks->on_sync != NULL) {
        hooks->on_sync(hooks->ctx);
    }
}

static void receive_sdo(struct co_node *node, const struct can_frame *frame, bool by_second)
{
    const struct od_data *od = node->config.od;
    node->by_second = by_second;
    if (by_second) {
        co_sdo_receive(&node->second_sdo, frame, (uint16_t)od->sdo_server_2.cob_id_response);
    } else {
        co_sdo_receive(&node->sdo, frame, (uint16_t)od->sdo_server.cob_id_response);
    }
    node->by_second = false;
}

/* Services that a node in pre-operational, operational or stopped has (CiA 301, 7.3.2). */
static void receive(struct co_node *node, const struct can_frame *frame)
{
    const enum co_state state = node->nmt.state;
    const struct od_data *od = node->config.od;
    const bool by_second = co_has_second_sdo(node) && frame->id == od->sdo_server_2.cob_id_request;
    if (by_second || frame->id == CO_SDO_REQUEST_ID + node->config.node_id) {
        if (state != CO_STOPPED) {
            receive_sdo(node, frame, by_second);
        }
    } else if ((frame->id & SERVICE_MASK) == CO_HEARTBEAT_ID) {
        co_nmt_heartbeat(&node->nmt, frame);
    } else if (state == CO_OPERATIONAL) {
        if (frame->id == (node->config.od->sync_cob_id & COB_ID_MASK)) {
            receive_sync(node, frame);
        } else {
            co_pdo_receive(&node->pdo, frame);
        }
    }
}

void co_receive(struct co_node *node, const struct can_frame *frame)
{
    if (frame->rtr) {
        if (node->nmt.state != CO_INITIALISING && frame->id == CO_HEARTBEAT_ID + node->config.node_id) {
            co_nmt_guard(&node->nmt);
        }
        return;
    }
    if (frame->id == CO_NMT_COMMAND_ID) {
        execute(node, co_nmt_decode(&node->nmt, frame));
    } else if (frame->id == CO_LSS_REQUEST) {
        if (co_lss_receive(&node->lss, frame)) {
            reset(node, true);
        }
    } else if (node->nmt.state != CO_INITIALISING) {
        receive(node, frame);
    }
}

/* SDOs go last, so that PDOs find room on the bus. */
void co_tick_ms(struct co_node *node)
{
    co_lss_tick_ms(&node->lss);
    co_tx_flush(&node->tx);
    co_bus_state_tick_ms(&node->bus_state);
    co_emcy_tick_ms(&node->emcy);
    if (co_nmt_tick_ms(&node->nmt)) {
        heartbeat_lost(node);
    }
    if (node->nmt.state == CO_OPERATIONAL) {
        co_pdo_tick_ms(&node->pdo);
    }
    if (node->nmt.state == CO_STOPPED) { /* a node that is stopped has no SDOs */
        co_sdo_reset(&node->sdo);
        co_sdo_reset(&node->second_sdo);
    } else {
        co_sdo_tick_ms(&node->sdo);
        co_sdo_tick_ms(&node->second_sdo);
    }
}

/* ---- for the application ---- */

enum co_state co_nmt_state(const struct co_node *node)
{
    return node->nmt.state;
}

void co_watch_heartbeat(struct co_node *node, uint8_t id)
{
    co_nmt_watch(&node->nmt, id);
}

bool co_heartbeat_lost(const struct co_node *node)
{
    return node->nmt.lost;
}

bool co_master_lost(const struct co_node *node)
{
    return node->nmt.lost || node->nmt.guard_lost;
}

bool co_rpdo_late(const struct co_node *node)
{
    return node->nmt.state == CO_OPERATIONAL && co_pdo_late(&node->pdo);
}

void co_emcy_set(struct co_node *node, uint16_t code, uint8_t reg, uint32_t details)
{
    co_emcy_raise(&node->emcy, code, reg, details);
}

void co_emcy_reset(struct co_node *node, uint16_t code)
{
    co_emcy_clear(&node->emcy, code);
}

uint16_t co_emcy_code(const struct co_node *node, unsigned i)
{
    return i < node->emcy.count ? node->emcy.code[i] : 0;
}

bool co_emcy_of_node(const struct co_node *node)
{
    static const uint16_t codes[CO_ERRORS_OF_NODE] = {CO_EMCY_OVERRUN,    CO_EMCY_PASSIVE,      CO_EMCY_WAS_OFF,
                                                      CO_EMCY_PDO_VALUE,  CO_EMCY_PDO_SHORT,    CO_EMCY_PDO_LATE,
                                                      CO_EMCY_ONE_AXIS,   CO_EMCY_PDO_LONG,     CO_EMCY_SYNC_LENGTH,
                                                      CO_EMCY_FLASH_WORN, CO_EMCY_SAVE_REFUSED, CO_EMCY_QUEUE_FULL};
    for (unsigned i = 0; i < CO_ERRORS_OF_NODE; i++) {
        if (co_emcy_in_effect(&node->emcy, codes[i])) {
            return true;
        }
    }
    return false;
}

bool co_has_second_sdo(const struct co_node *node)
{
    const struct od_sdo_server_2 *server = &node->config.od->sdo_server_2;
    return ((server->cob_id_request | server->cob_id_response) & COB_UNUSED) == 0;
}

bool co_by_second_sdo(const struct co_node *node)
{
    return node->by_second;
}

bool co_tpdo_send(struct co_node *node, unsigned number)
{
    return node->nmt.state == CO_OPERATIONAL && co_pdo_send(&node->pdo, number);
}

bool co_rpdo_carries(const struct co_node *node, unsigned number, uint16_t index)
{
    return co_pdo_carries(&node->pdo.rpdo[number - 1].mapping, index);
}

bool co_tpdo_carries(const struct co_node *node, unsigned number, uint16_t index)
{
    return co_pdo_carries(&node->pdo.tpdo[number - 1].mapping, index);
}

bool co_tpdo_in_use(const struct co_node *node, unsigned number)
{
    return node->pdo.tpdo[number - 1].id != 0u;
}
