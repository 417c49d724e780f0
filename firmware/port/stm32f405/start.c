/* SPDX-License-Identifier: Apache-2.0 */
/* start.c: the vector table, and the start-up code from reset to main_loop_start() (DDI 0403E B1.5; RM0090 12,
 * vector table). The hardware calls it at reset. */
#include <stdint.h>

#include "port/stm32f405/board.h"
#include "port/stm32f405/can.h"
#include "port/stm32f405/clock.h"
#include "port/stm32f405/cpu.h"
#include "port/stm32f405/crash.h"
#include "port/stm32f405/main_loop.h"
#include "port/stm32f405/supply.h"
#include "port/stm32f405/uart.h"

/* Symbols of kontur.ld. */
extern uint32_t kontur_stack_top[], kontur_data[], kontur_data_end[], kontur_bss[], kontur_bss_end[];
extern const uint32_t kontur_vectors[], kontur_data_load[];

_Noreturn void reset_irq(void);

/* Initialises RAM. Until it has done so, no library function
 * may be called: the compiler must not make one of its loops. */
__attribute__((optimize("no-tree-loop-distribute-patterns"))) _Noreturn void reset_irq(void)
{
    SCB->VTOR = (uint32_t)(uintptr_t)kontur_vectors; /* a loader that has started the image leaves its own */
    SCB->CPACR |= SCB_CPACR_FPU;
    SCB->CCR |= SCB_CCR_DIV_0_TRP;
    cpu_barrier();
    const uint32_t *from = kontur_data_load;
    for (uint32_t *to = kontur_data; to < kontur_data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = kontur_bss; to < kontur_bss_end; to++) {
        *to = 0;
    }
    main_loop_start();
    for (;;) {
        main_loop_pass();
    }
}

typedef void (*vector)(void);
struct vectors {
    uint32_t *stack;
    vector exception[15];
    vector irq[IRQS];
};

_Pragma("GCC diagnostic push") _Pragma("GCC diagnostic ignored \"-Woverride-init\"")
    __attribute__((section(".vectors"), used)) static const struct vectors vectors = {
        .stack = kontur_stack_top,
        .exception = {[0 ... 14] = crash_irq, [0] = reset_irq, [1] = clock_failed_irq, [14] = tick_irq},
        .irq = {[0 ... IRQS - 1] = crash_irq,
                [IRQ_PVD] = supply_irq,
                [IRQ_CAN1_TX] = can_tx_irq,
                [IRQ_CAN1_RX0] = can_rx_irq,
                [IRQ_CAN1_SCE] = can_error_irq,
                [BOARD_UART_IRQ] = uart_irq},
};
_Pragma("GCC diagnostic pop")
