/* SPDX-License-Identifier: Apache-2.0 */
#include "port/linux/message.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static void print_line(const char *format, va_list arguments)
{
    fputs("kontur-sim: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
}

void print_message(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    print_line(format, arguments);
    va_end(arguments);
}

void fatal(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    print_line(format, arguments);
    va_end(arguments);
    exit(1);
}
