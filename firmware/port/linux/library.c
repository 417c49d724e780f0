/* SPDX-License-Identifier: Apache-2.0 */
/* library.c: finds and loads libkontur, library.h. */
#include "port/linux/library.h"

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "port/linux/message.h"

static void *find(void *handle, const char *name)
{
    void *function = dlsym(handle, name);
    if (function == NULL) {
        fatal("%s: run `make lib` again", dlerror());
    }
    return function;
}

void library_load(struct library *library, const char *num)
{
    char program[PATH_MAX];
    const ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
    program[length < 0 ? 0 : length] = '\0';
    const char *slash = strrchr(program, '/');
    const int folder = slash == NULL ? 0 : (int)(slash - program);

    if (strcmp(num, "f32") != 0 && strcmp(num, "fix") != 0 && strcmp(num, "chk") != 0) {
        fatal("--num %s: there is no such numeric back end; choose f32, fix or chk", num);
    }
    char path[PATH_MAX + 32];
    snprintf(path, sizeof path, "%.*s/libkontur_%s.so", folder, program, num);
    library->handle = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (library->handle == NULL) {
        fatal("%s: run `make lib` in the source folder", dlerror());
    }
    /* POSIX's dlsym() returns a function as void *, which C cannot convert to a function pointer. */
#define LIBRARY_FIND(name) *(void **)&library->name = find(library->handle, #name);
    LIBRARY_FUNCTIONS(LIBRARY_FIND)
#undef LIBRARY_FIND
}
