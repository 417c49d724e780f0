/* SPDX-License-Identifier: Apache-2.0 */
/* whole_file.c: files of kontur-sim, whole_file.h. kontur.files does the same for the host tools. */
#include "port/linux/whole_file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

static bool write_all(int file, const char *data, size_t bytes)
{
    while (bytes > 0) {
        const ssize_t written = write(file, data, bytes);
        if (written < 0 && errno != EINTR) {
            return false;
        }
        data += written < 0 ? 0 : written;
        bytes -= written < 0 ? 0 : (size_t)written;
    }
    return true;
}

/* Close the file and pass `ok` on, with the errno of its first failure. */
static bool closed(int file, bool ok)
{
    const int error = errno;
    const bool good = close(file) == 0;
    if (!ok) {
        errno = error;
    }
    return ok && good;
}

/* Bring the names in a folder to the disk; some file systems do that by themselves, and refuse it. */
static bool sync_folder(const char *folder)
{
    const int file = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return file >= 0 && closed(file, fsync(file) == 0 || errno == EINVAL);
}

/* Make a file with a name that nobody can foresee in `folder` (which ends in a slash), with the
 * name in `part`. -1: errno says why. */
static int open_part(const char *folder, char part[PATH_MAX])
{
    unsigned long long name;
    if (getrandom(&name, sizeof name, 0) != (ssize_t)sizeof name) {
        return -1;
    }
    if (snprintf(part, PATH_MAX, "%s.kontur-%016llx.part", folder, name) >= PATH_MAX) {
        errno = ENAMETOOLONG;
        return -1;
    }
    return open(part, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
}

/* Put the file that is complete in place of the target, which exists: as its owner's, and with its mode. */
static bool replace(const char *target, const struct stat *old, const void *data, size_t bytes)
{
    char folder[PATH_MAX], part[PATH_MAX];
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(target, '/') - target) + 1, target);
    const int file = open_part(folder, part);
    if (file < 0) {
        return false;
    }
    (void)!fchown(file, old->st_uid, old->st_gid); /* only root may give a file away */
    bool ok = fchmod(file, old->st_mode & 07777) == 0 && write_all(file, data, bytes) && fsync(file) == 0;
    ok = closed(file, ok) && rename(part, target) == 0;
    if (!ok) {
        const int error = errno;
        (void)unlink(part);
        errno = error;
    }
    return ok && sync_folder(folder);
}

bool whole_file_write(const char *path, const void *data, size_t bytes)
{
    char target[PATH_MAX];
    struct stat status;
    const bool is_new = stat(path, &status) != 0;
    const int file = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0666); /* a new one gets the mode of the umask */
    if (file < 0 || fstat(file, &status) != 0) {
        return false;
    }
    if (!S_ISREG(status.st_mode)) {
        return closed(file, write_all(file, data, bytes));
    }
    (void)close(file);
    if (realpath(path, target) == NULL) {
        return false;
    }
    const bool ok = replace(target, &status, data, bytes);
    if (!ok && is_new) {
        const int error = errno;
        (void)unlink(target);
        errno = error;
    }
    return ok;
}

ssize_t whole_file_read(const char *path, void *data, size_t bytes)
{
    struct stat status;
    const int file = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0) {
        return -1;
    }
    size_t got = 0;
    ssize_t more = fstat(file, &status);
    if (more == 0 && !S_ISREG(status.st_mode)) {
        errno = S_ISDIR(status.st_mode) ? EISDIR : EINVAL;
        more = -1;
    }
    while (more >= 0 && got < bytes && (more = read(file, (char *)data + got, bytes - got)) > 0) {
        got += (size_t)more;
    }
    return closed(file, more >= 0) ? (ssize_t)got : -1;
}
