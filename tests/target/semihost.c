/* SPDX-License-Identifier: Apache-2.0 */
/* semihost.c: start-up of a test program in QEMU, with standard output and exit code by semihosting (Arm,
 * "Semihosting for AArch32 and AArch64", sections 6.5, 6.9, 6.18), and its instruction counter.
 */
#include <stdint.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "target.h"

extern uint32_t data_load, data_begin, data_end, bss_begin, bss_end, stack_top;
int main(void);
_Noreturn void reset(void);
_Noreturn void _exit(int code);
int _write(int file, const char *data, int bytes);
void *_sbrk(int bytes);
int _close(int file);
int _fstat(int file, struct stat *st);
int _isatty(int file);
int _lseek(int file, int offset, int whence);
int _read(int file, char *data, int bytes);
int _getpid(void);
int _kill(int pid, int signal);

enum { SYS_WRITEC = 0x03, SYS_EXIT_EXTENDED = 0x20, APPLICATION_EXIT = 0x20026 };

static uint32_t semihost(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static _Noreturn void fault(void)
{
    _exit(99);
}

__attribute__((section(".vectors"), used)) static const void *const vectors[] = {
    &stack_top,          (const void *)reset, (const void *)fault, (const void *)fault,
    (const void *)fault, (const void *)fault, (const void *)fault};

void reset(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: enable the FPU, if there is one */
    __asm__ volatile("dsb\n isb");
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_begin; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_begin; to < &bss_end;) {
        *to++ = 0;
    }
    exit(main());
}

void _exit(int code)
{
    const uint32_t block[2] = {APPLICATION_EXIT, (uint32_t)code};
    for (;;) {
        semihost(SYS_EXIT_EXTENDED, block);
    }
}

int _write(int file, const char *data, int bytes)
{
    (void)file;
    for (int i = 0; i < bytes; i++) {
        semihost(SYS_WRITEC, data + i);
    }
    return bytes;
}

/* ---- the instruction counter, which is TIM2 (RM0090, section 18.4). QEMU runs it at 1 GHz, which with -icount
 * shift=0 is one count for each instruction. ---- */

#define TIM2(offset) (*(volatile uint32_t *)(0x40000000u + (offset)))

void count_start(void)
{
    TIM2(0x2C) = 0xFFFFFFFFu; /* ARR */
    TIM2(0x14) = 1;           /* EGR: load ARR */
    TIM2(0x00) = 1;           /* CR1: run */
}

uint32_t count_now(void)
{
    return TIM2(0x24);
}

/* ---- the system calls of newlib ---- */

void *_sbrk(int bytes)
{
    static char heap[4096];
    static int used;
    if (used + bytes > (int)sizeof heap) {
        return (void *)-1;
    }
    used += bytes;
    return heap + used - bytes;
}

int _close(int file)
{
    (void)file;
    return -1;
}

int _fstat(int file, struct stat *st)
{
    (void)file;
    st->st_mode = S_IFCHR;
    return 0;
}

int _isatty(int file)
{
    (void)file;
    return 1;
}

int _lseek(int file, int offset, int whence)
{
    (void)file;
    (void)offset;
    (void)whence;
    return 0;
}

int _read(int file, char *data, int bytes)
{
    (void)file;
    (void)data;
    (void)bytes;
    return 0;
}

int _getpid(void)
{
    return 1;
}

int _kill(int pid, int signal)
{
    (void)pid;
    (void)signal;
    return -1;
}
