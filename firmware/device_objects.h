/* SPDX-License-Identifier: Apache-2.0 */
/* device_objects.h: what reading and writing objects by SDO does beside their values.
 *
 * One table says for each object what is checked before a write, which command the write is, what follows once the value
 * is stored, and what is brought up to date before a read. A check changes nothing; a command returns the SDO abort code.
 * Parameters (OD_CONFIG) have rules of their own: no axis has power, unless they are OD_LIVE, and they fit together.
 *
 * Context: background. device.c calls it from the hooks of the CANopen node.
 */
#ifndef KONTUR_DEVICE_OBJECTS_H
#define KONTUR_DEVICE_OBJECTS_H
#include "canopen/node.h"
#include "drive/drive.h"
#include "od/settings.h"

struct device_objects {
    struct od_data *od;
    struct co_node *node;
    struct drive *drive;
    struct settings *settings;
};

/* Whether what is handled now came from another master than the one that holds the drive: not by the holder's own channel
 * (1201h) or, where it has none, not within a second after its ticket (2140h). */
bool device_objects_foreign(const struct device_objects *d);
/* Before a write: check `value`, which is in the object's range, and carry out the command that the write is. Returns SDO_OK,
 * or the abort code with which the write is refused. */
uint32_t device_objects_before_write(const struct device_objects *d, const struct od_entry *entry, int64_t value);
/* Whether the object takes `value`, which is in its range: SDO_OK, or the abort code. */
uint32_t device_objects_check(const struct device_objects *d, const struct od_entry *entry, int64_t value);
/* After a write. Returns true if a drive step is to follow. *received says whose controlword was written, as in drive_in. */
bool device_objects_written(const struct device_objects *d, const struct od_entry *entry, unsigned *received);
/* Before a read: bring the value of the object up to date. */
void device_objects_before_read(const struct device_objects *d, const struct od_entry *entry);
#endif
