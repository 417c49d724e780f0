/* SPDX-License-Identifier: Apache-2.0 */
/* machine_file.h: a machine as plain text. `kontur sim` writes it from the TOML file, and main.c reads it when the
 * process kontur-sim starts. Each field of struct ks_machine has a line with its name and its values in SI units:
 *
 *   mass_kg 88.08 97.9
 *   delay_periods 1
 *   schedule_time_s 0 1.6
 *
 * The path "-" is standard input. Empty lines and lines that start with # are ignored. All fields are required except
 * those of the schedule, switch_m, index_m and those of a real machine, which are not there then.
 */
#ifndef KONTUR_MACHINE_FILE_H
#define KONTUR_MACHINE_FILE_H
#include "sim/kontur_sim.h"

/* A mistake in the file ends the process with a message that names file and line. ks_check() checks the ranges. */
void machine_file_read(const char *path, struct ks_machine *machine);
#endif
