/* SPDX-License-Identifier: Apache-2.0 */
/* machine_file.c: the parser of machine_file.h. */
#include "port/linux/machine_file.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "port/linux/message.h"

enum { SCHEDULE_ROWS = 16, LINE_BYTES = 1024 };

struct field {
    const char *name;
    size_t offset;
    unsigned least, greatest; /* number of its values */
    bool integer;             /* its values are int32_t; otherwise double */
};

#define FIELD(name, least, greatest, integer) {#name, offsetof(struct ks_machine, name), least, greatest, integer}
static const struct field fields[] = {
    FIELD(mass_kg, 2, 2, false),
    FIELD(viscous_Nspm, 2, 2, false),
    FIELD(coulomb_N, 2, 2, false),
    FIELD(breakaway, 2, 2, false),
    FIELD(stribeck_mps, 2, 2, false),
    FIELD(force_limit_N, 2, 2, false),
    FIELD(force_noise_N, 2, 2, false),
    FIELD(current_lag_s, 2, 2, false),
    FIELD(encoder_m, 2, 2, false),
    FIELD(travel_min_m, 2, 2, false),
    FIELD(travel_max_m, 2, 2, false),
    FIELD(switch_m, 0, 2, false),
    FIELD(index_m, 0, 2, false),
    FIELD(start_m, 2, 2, false),
    FIELD(delay_periods, 1, 1, true),
    FIELD(substeps, 1, 1, true),
    FIELD(schedule_count, 0, 1, true),
    FIELD(schedule_time_s, 0, SCHEDULE_ROWS, false),
    FIELD(schedule_scale, 0, SCHEDULE_ROWS, false),
    FIELD(schedule_repeat_s, 0, 1, false),
    FIELD(resonance_Hz, 0, 2, false),
    FIELD(resonance_damping, 0, 2, false),
    FIELD(motor_share, 0, 2, false),
    FIELD(encoder_at_table, 0, 2, true),
    FIELD(encoder_inverted, 0, 2, true),
    FIELD(force_inverted, 0, 2, true),
    FIELD(scale_m, 0, 2, false),
    FIELD(backlash_m, 0, 2, false),
    FIELD(presliding_m, 0, 2, false),
    FIELD(friction_share, 0, 2, false),
    FIELD(friction_wave, 0, 2, false),
    FIELD(screw_m, 0, 2, false),
    FIELD(cogging_N, 0, 2, false),
    FIELD(ripple, 0, 2, false),
    FIELD(encoder_once_m, 0, 2, false),
    FIELD(interpolation_m, 0, 2, false),
    FIELD(interpolation_period_m, 0, 2, false),
    FIELD(force_bits, 0, 2, false),
    FIELD(continuous_force_N, 0, 2, false),
    FIELD(thermal_s, 0, 2, false),
    FIELD(lead_error, 0, 2, false),
    FIELD(lead_once_m, 0, 2, false),
    FIELD(squareness_rad, 0, 2, false),
    FIELD(crosstalk_s2, 0, 2, false),
    FIELD(cutting_force_N, 0, 2, false),
    FIELD(cutting_Hz, 0, 2, false),
};
enum { FIELDS = sizeof fields / sizeof *fields };

static const struct field *find(const char *name)
{
    for (unsigned i = 0; i < FIELDS; i++) {
        if (strcmp(fields[i].name, name) == 0) {
            return &fields[i];
        }
    }
    return NULL;
}

/* Set value `index` of the field from `text`. false: it is not a number of that kind. */
static bool set(struct ks_machine *machine, const struct field *field, unsigned index, const char *text)
{
    char *end = NULL;
    char *at = (char *)machine + field->offset;
    errno = 0;
    if (field->integer) {
        const long value = strtol(text, &end, 10);
        if (*end != '\0' || errno != 0 || value < INT32_MIN || value > INT32_MAX) {
            return false;
        }
        const int32_t narrow = (int32_t)value;
        memcpy(at + index * sizeof narrow, &narrow, sizeof narrow);
        return true;
    }
    const double value = strtod(text, &end);
    if (*end != '\0' || !isfinite(value)) {
        return false;
    }
    memcpy(at + index * sizeof value, &value, sizeof value);
    return true;
}

void machine_file_read(const char *path, struct ks_machine *machine)
{
    static const char gaps[] = " \t\r\n";
    char line[LINE_BYTES];
    bool seen[FIELDS] = {false};
    FILE *file = strcmp(path, "-") == 0 ? stdin : fopen(path, "r");
    if (file == NULL) {
        fatal("machine %s cannot be read: %s", path, strerror(errno));
    }
    *machine = (struct ks_machine){0};
    for (unsigned number = 1; fgets(line, sizeof line, file) != NULL; number++) {
        char *position = NULL;
        const char *name = strtok_r(line, gaps, &position);
        if (name == NULL || name[0] == '#') {
            continue;
        }
        const struct field *field = find(name);
        if (field == NULL) {
            fatal("machine %s:%u: %s: no such field; `kontur sim` writes this file from a TOML file", path, number,
                  name);
        }
        unsigned count = 0;
        for (const char *value; (value = strtok_r(NULL, gaps, &position)) != NULL; count++) {
            if (count == field->greatest || !set(machine, field, count, value)) {
                fatal("machine %s:%u: %s: %s: not a number that belongs here", path, number, name, value);
            }
        }
        if (count < field->least) {
            fatal("machine %s:%u: %s: has %u of %u values", path, number, name, count, field->least);
        }
        seen[field - fields] = true;
    }
    fclose(file);
    for (unsigned i = 0; i < FIELDS; i++) {
        if (!seen[i] && fields[i].least > 0) {
            fatal("machine %s: %s is missing", path, fields[i].name);
        }
    }
}
