/* SPDX-License-Identifier: Apache-2.0 */
#include "port/linux/message.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

/* Print a line. Control characters of what comes from outside, such as a file name, are printed as \x1b is. */
static void print_line(const char *format, va_list arguments)
{
    char text[8192];
    vsnprintf(text, sizeof text, format, arguments);
    fputs("kontur-sim: ", stderr);
    for (const unsigned char *c = (const unsigned char *)text; *c != '\0'; c++) {
        const bool c1 = c[0] == 0xC2 && c[1] >= 0x80 && c[1] < 0xA0; /* 80h..9Fh in UTF-8 */
        c += c1 ? 1 : 0;
        if (c1 || *c < ' ' || *c == 0x7F) {
            fprintf(stderr, "\\x%02x", *c);
        } else {
            fputc(*c, stderr);
        }
    }
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
