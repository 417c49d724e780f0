/* SPDX-License-Identifier: Apache-2.0 */
#include "port/linux/say.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static void tell(const char *format, va_list arguments)
{
    fputs("kontur-sim: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
}

void say(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    tell(format, arguments);
    va_end(arguments);
}

void die(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    tell(format, arguments);
    va_end(arguments);
    exit(1);
}
