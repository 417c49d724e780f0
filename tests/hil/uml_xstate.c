/* SPDX-License-Identifier: Apache-2.0 */
/* Lets User-Mode Linux 6.1 (Debian 12) run on processors with more register state than it knows: AMX, since 2023.
 *
 * UML keeps the extended registers of a guest process in a buffer of fixed size, and gives them back by
 * ptrace(PTRACE_SETREGSET, NT_X86_XSTATE), which refuses anything but the whole area (EFAULT: "ptrace set fp regs failed,
 * errno = 14"). Preloaded into linux.uml, this puts what UML has kept in front of what the process has now, so that the
 * state components that UML does not know stay as they are.
 *
 * Layout of the area: Intel SDM volume 1, 13.4: legacy area, XSAVE header with XSTATE_BV at byte 512, then the
 * components in their standard form.
 */
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

enum { AREA_MAX = 1 << 16, XSTATE_BV = 512, HEADER_END = 576 };
#define KEPT_COMPONENTS 0xFFu /* x87, SSE, AVX, MPX, AVX-512: they end at byte 2688, which UML's buffer holds */

static unsigned char area[AREA_MAX]; /* UML has one thread, and small stacks */
static long (*libc_ptrace)(int, ...);

__attribute__((constructor)) static void find_libc_ptrace(void)
{
    *(void **)&libc_ptrace = dlsym(RTLD_NEXT, "ptrace");
}

static long set_registers(int pid, void *kind, struct iovec *kept)
{
    struct iovec whole = {area, sizeof area};
    if (libc_ptrace(PTRACE_GETREGSET, pid, kind, &whole) != 0 || kept->iov_len < HEADER_END ||
        kept->iov_len >= whole.iov_len) {
        return libc_ptrace(PTRACE_SETREGSET, pid, kind, kept);
    }
    uint64_t has, had;
    memcpy(&has, area + XSTATE_BV, sizeof has);
    memcpy(area, kept->iov_base, kept->iov_len);
    memcpy(&had, area + XSTATE_BV, sizeof had);
    has = (has & ~(uint64_t)KEPT_COMPONENTS) | (had & KEPT_COMPONENTS);
    memcpy(area + XSTATE_BV, &has, sizeof has);
    return libc_ptrace(PTRACE_SETREGSET, pid, kind, &whole);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list rest;
    va_start(rest, request);
    const int pid = va_arg(rest, int);
    void *address = va_arg(rest, void *);
    void *data = va_arg(rest, void *);
    va_end(rest);
    if (request == PTRACE_SETREGSET && (uintptr_t)address == NT_X86_XSTATE) {
        return set_registers(pid, address, data);
    }
    return libc_ptrace((int)request, pid, address, data);
}
