/* SPDX-License-Identifier: Apache-2.0 */
/* interrupts.h: what start.c calls that no other header has. */
#ifndef KONTUR_INTERRUPTS_H
#define KONTUR_INTERRUPTS_H
/* SysTick: the servo tick, CONTROL_HZ. */
void tick_irq(void);
void reset_irq(void);
int main(void);
#endif
