/* SPDX-License-Identifier: Apache-2.0 */
/* machine_file.h: a machine in plain form, which `kontur sim` writes from the TOML file: a line for each field of
 * struct ks_machine, its name and its values, SI:
 *
 *   mass_kg 88.08 97.9
 *   delay_periods 1
 *   schedule_time_s 0 1.6
 *
 * "-" is standard input. Empty lines and lines that start with # are passed over. All fields must be there, but those
 * of the schedule.
 */
#ifndef KONTUR_MACHINE_FILE_H
#define KONTUR_MACHINE_FILE_H
#include "sim/kontur_sim.h"

/* Ends the program with a message, of file and line, when there is no machine in it. Ranges are for ks_check(). */
void machine_file_read(const char *path, struct ks_machine *machine);
#endif
