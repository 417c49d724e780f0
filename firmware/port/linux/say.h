/* SPDX-License-Identifier: Apache-2.0 */
/* say.h: messages to stderr, each one line with the program's name in front. */
#ifndef KONTUR_SAY_H
#define KONTUR_SAY_H

__attribute__((format(printf, 1, 2))) void say(const char *format, ...);
/* The same, then end with exit status 1. */
__attribute__((format(printf, 1, 2), noreturn)) void die(const char *format, ...);
#endif
