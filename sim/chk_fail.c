/* SPDX-License-Identifier: Apache-2.0 */
/* chk_fail.c: ends a program whose checking back end (num_chk.h) has found an error. It calls abort(), so that
 * neither a test nor a script takes its output for a result. It is linked into libkontur_chk and tests.
 */
#include <stdio.h>
#include <stdlib.h>

#include "core/num.h"

void chk_fail(const char *what, const char *file, int line, double value, double shadow)
{
    fflush(stdout);
    fprintf(stderr, "%s:%d: %s: fixed point has %.9g, double %.9g\n", file, line, what, value, shadow);
    abort();
}
