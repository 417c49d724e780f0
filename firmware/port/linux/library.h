/* SPDX-License-Identifier: Apache-2.0 */
/* library.h: loads libkontur with one numeric back end from the folder
 * of the program. main.c calls it when the process kontur-sim starts. */
#ifndef KONTUR_LIBRARY_H
#define KONTUR_LIBRARY_H
#include "sim/kontur_sim.h"

/* The functions of kontur_sim.h that the process uses. */
/* clang-format off */
#define LIBRARY_FUNCTIONS(F) \
    F(ks_new) \
    F(ks_free) \
    F(ks_check) \
    F(ks_send) \
    F(ks_recv) \
    F(ks_step) \
    F(ks_tick) \
    F(ks_control_hz) \
    F(ks_build) \
    F(ks_set_can_status) \
    F(ks_flash) \
    F(ks_flash_operations) \
    F(ks_on_flash) \
    F(ks_power_on_with) \
    F(ks_set_paced) \
    F(ks_set_entropy) \
    F(ks_sync_id) \
    F(ks_sync_us) \
    F(ks_record) \
    F(ks_record_count) \
    F(ks_record_data)
/* clang-format on */

#define LIBRARY_POINTER(name) __typeof__(name) *name; /* NOLINT(bugprone-macro-parentheses) */
struct library {
    void *handle;
    LIBRARY_FUNCTIONS(LIBRARY_POINTER)
};
#undef LIBRARY_POINTER

/* num is "f32", "fix" or "chk". A library that cannot be loaded ends the process with a message. */
void library_load(struct library *library, const char *num);
#endif
