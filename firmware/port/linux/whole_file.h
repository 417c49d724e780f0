/* SPDX-License-Identifier: Apache-2.0 */
/* whole_file.h: reads and writes files completely or not at all. main.c calls it, for the store and the record. */
#ifndef KONTUR_WHOLE_FILE_H
#define KONTUR_WHOLE_FILE_H
#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

/* Write a file, and return true when it is on the disk. false: errno says why not, and the old file is still there.
 * It has a name of its own in the folder of `path` until it is complete. Of a link the target is replaced. A file that
 * is replaced keeps its mode and, where that is allowed, its owner. What is no regular file is written to directly. */
bool whole_file_write(const char *path, const void *data, size_t bytes);
/* Read at most `bytes` bytes of a regular file. Returns how many the file has given, or -1, and errno says why. */
ssize_t whole_file_read(const char *path, void *data, size_t bytes);
#endif
