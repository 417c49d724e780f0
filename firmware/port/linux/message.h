/* SPDX-License-Identifier: Apache-2.0 */
/* message.h: messages of the process kontur-sim to standard error, each one line with the program's name in front.
 * All files of this folder call them. */
#ifndef KONTUR_MESSAGE_H
#define KONTUR_MESSAGE_H

__attribute__((format(printf, 1, 2))) void print_message(const char *format, ...);
/* Print the message, then end the process with exit status 1. */
__attribute__((format(printf, 1, 2), noreturn)) void fatal(const char *format, ...);
#endif
