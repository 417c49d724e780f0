/* SPDX-License-Identifier: Apache-2.0 */
/* chk_fail.c: where the checking back end (num_chk.h) ends a program. The exit code is that of a signalled abort, so that
 * neither a test nor a script takes it for a result. */
#include <stdio.h>
#include <stdlib.h>

#include "core/num.h"

void chk_fail(const char *what, const char *file, int line, double value, double shadow)
{
    fflush(stdout);
    fprintf(stderr, "%s:%d: %s: fixed point has %.9g, double %.9g\n", file, line, what, value, shadow);
    abort();
}
