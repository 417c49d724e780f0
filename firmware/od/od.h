/* SPDX-License-Identifier: Apache-2.0 */
/* od/od.h: the object dictionary (CiA 301, 7.4): values, and the table that describes them.
 *
 * Everything that the bus can read or write is an object: parameters, commands, actual values. Values are in a
 * struct od_data that the caller owns. Its fields and the table are generated from od/objects.toml (od_gen.h):
 * od.smc.lambda, od.heartbeat_producer, od.axis[AXIS_X].plant.mass. Fields hold integers in wire units, which the
 * comment beside each field names. An i24 is stored in an int32_t. Constants take no memory.
 *
 * Background only, and nothing here is locked: the servo interrupt works on copies.
 */
#ifndef OD_H
#define OD_H
#include <stdint.h>

#include "od/od_gen.h"

/* SDO abort codes (CiA 301, table 22) */
#define SDO_OK 0x00000000u
#define SDO_ABORT_TOGGLE 0x05030000u
#define SDO_ABORT_TIMEOUT 0x05040000u
#define SDO_ABORT_COMMAND 0x05040001u
#define SDO_ABORT_BLOCK_SIZE 0x05040002u
#define SDO_ABORT_SEQUENCE 0x05040003u
#define SDO_ABORT_CRC 0x05040004u
#define SDO_ABORT_WRITE_ONLY 0x06010001u
#define SDO_ABORT_READ_ONLY 0x06010002u
#define SDO_ABORT_NO_OBJECT 0x06020000u
#define SDO_ABORT_NO_MAPPING 0x06040041u
#define SDO_ABORT_PDO_LENGTH 0x06040042u
#define SDO_ABORT_INCOMPATIBLE 0x06040043u
#define SDO_ABORT_HARDWARE 0x06060000u
#define SDO_ABORT_LENGTH 0x06070010u
#define SDO_ABORT_TOO_LONG 0x06070012u
#define SDO_ABORT_TOO_SHORT 0x06070013u
#define SDO_ABORT_NO_SUB 0x06090011u
#define SDO_ABORT_VALUE 0x06090030u
#define SDO_ABORT_TOO_HIGH 0x06090031u
#define SDO_ABORT_TOO_LOW 0x06090032u
#define SDO_ABORT_STORE 0x08000020u
#define SDO_ABORT_LOCAL 0x08000021u
#define SDO_ABORT_STATE 0x08000022u
#define SDO_ABORT_NO_DATA 0x08000024u

/* Values of the node id 2001h:1: none is set (CiA 305), and the largest one. TPDO5 takes identifiers from 1C1h on. */
enum { OD_UNCONFIGURED = 255, OD_NODE_MAX = 31 };

/* Areas of the dictionary (CiA 301, 7.4.1). */
enum {
    OD_COMMUNICATION_FIRST = 0x1000,
    OD_PDO_FIRST = 0x1400, /* communication and mapping objects of PDOs */
    OD_PDO_LAST = 0x1BFF,
    OD_COMMUNICATION_LAST = 0x1FFF,
    OD_APPLICATION_FIRST = 0x2000, /* of the manufacturer, and of device profiles */
    OD_LAST = 0xFFFF,
};

/* Bits of the error register 1001h (CiA 301, 7.5.2.2). */
enum {
    CO_REG_GENERIC = 1, /* set with every error */
    CO_REG_CURRENT = 2,
    CO_REG_VOLTAGE = 4,
    CO_REG_TEMPERATURE = 8,
    CO_REG_COMMUNICATION = 16,
    CO_REG_PROFILE = 32,
    CO_REG_MANUFACTURER = 128,
};

enum od_type { OD_U8, OD_I8, OD_U16, OD_I16, OD_I24, OD_U32, OD_I32, OD_STRING, OD_DOMAIN };

enum od_flag {
    OD_READ = 1,
    OD_WRITE = 2,
    OD_CONST = 4,    /* the value is `min`; there is no field */
    OD_CONFIG = 8,   /* a parameter, which must not change while an axis is in operation enabled */
    OD_PDO = 16,     /* may be mapped into a PDO */
    OD_NODE_ID = 32, /* the default is `od_defaults` plus the node id */
    OD_LIVE = 64,    /* a parameter that may change at any time, and is in effect from the next movement on */
};

struct od_entry {
    uint16_t index;
    uint8_t sub;
    uint8_t type;    /* enum od_type */
    uint8_t flags;   /* enum od_flag */
    uint16_t offset; /* in struct od_data */
    int64_t min, max;
};

extern const struct od_data od_defaults; /* without the node id */
extern const struct od_entry od_table[]; /* sorted by index and sub-index */
extern const uint16_t od_table_len;

/* Set all values to their defaults. */
void od_init(struct od_data *od, uint8_t node_id);
/* Set the objects first..last to their defaults, as far as they can be written or follow the node id. */
void od_restore(struct od_data *od, uint8_t node_id, uint16_t first, uint16_t last);

/* The entry of an object. NULL: there is none, and *abort is SDO_ABORT_NO_OBJECT or SDO_ABORT_NO_SUB. */
const struct od_entry *od_find(uint16_t index, uint8_t sub, uint32_t *abort);
/* Bytes on the wire, 1..4; 0 for a string, whose length varies, and for a domain, which has no field. */
uint8_t od_size(const struct od_entry *entry);
/* The value of an entry that is a number. */
int64_t od_read(const struct od_data *od, const struct od_entry *entry);
/* The number at (index, sub); 0 where there is none. */
int64_t od_number(const struct od_data *od, unsigned index, unsigned sub);
/* The value of an entry that is a string; never NULL. */
const char *od_text(const struct od_data *od, const struct od_entry *entry);
/* SDO_OK, or the abort code for a value that is out of range. Access is not looked at. */
uint32_t od_check(const struct od_entry *entry, int64_t value);
/* Store a number that od_check() accepted. */
void od_write(struct od_data *od, const struct od_entry *entry, int64_t value);
/* The number in the first od_size() bytes, little-endian and sign-extended. */
int64_t od_decode(const struct od_entry *entry, const uint8_t *data);
#endif
