/* SPDX-License-Identifier: Apache-2.0 */
/* regs.h: the registers of the STM32F405 that this port uses, and
 * no others. The drivers of this folder use them in every context.
 *
 * Sources: ST, RM0090 "STM32F405/415, STM32F407/417, ... reference manual" (section of each block beside it; numbers
 * of its tables differ from revision to revision) and ARM, "ARMv7-M Architecture Reference Manual" (DDI 0403E) for
 * the core's own. Names are theirs, so that they can be looked up. Addresses, offsets and bits were compared with
 * ST's register description (STM32F40x.svd), and PWR_CR VOS, which it lacks, with ST's CMSIS header.
 *
 * On the chip a block lies at its address. Compiled for a host it is a field of `struct chip chip`, which a test
 * reads and writes (tests/unit/chip.h).
 */
#ifndef KONTUR_REGS_H
#define KONTUR_REGS_H
#include <stddef.h>
#include <stdint.h>

typedef volatile uint32_t reg;

/* RM0090 7.3 (RCC of the F405; chapter 6 is that of the F42x) */
struct rcc {
    reg CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, unused_1c, APB1RSTR, APB2RSTR, unused_28[2];
    reg AHB1ENR, AHB2ENR, AHB3ENR, unused_3c, APB1ENR, APB2ENR, unused_48[2];
    reg AHB1LPENR, AHB2LPENR, AHB3LPENR, unused_5c, APB1LPENR, APB2LPENR, unused_68[2], BDCR, CSR;
};
enum {
    RCC_CR_HSION = 1 << 0,
    RCC_CR_HSIRDY = 1 << 1,
    RCC_CR_HSEON = 1 << 16,
    RCC_CR_HSERDY = 1 << 17,
    RCC_CR_CSSON = 1 << 19,
    RCC_CR_PLLON = 1 << 24,
    RCC_CR_PLLRDY = 1 << 25,
    RCC_PLLCFGR_N = 6,
    RCC_PLLCFGR_P = 16,
    RCC_PLLCFGR_HSE = 1 << 22,
    RCC_PLLCFGR_Q = 24,
    RCC_CFGR_SW = 3,
    RCC_CFGR_SW_HSI = 0,
    RCC_CFGR_SW_PLL = 2,
    RCC_CFGR_SWS = 3 << 2,
    RCC_CFGR_SWS_HSI = 0,
    RCC_CFGR_SWS_PLL = 2 << 2,
    RCC_CFGR_PPRE1_DIV4 = 5 << 10,
    RCC_CFGR_PPRE2_DIV2 = 4 << 13,
    RCC_CIR_CSSF = 1 << 7,
    RCC_CIR_CSSC = 1 << 23,
    RCC_APB1ENR_TIM2 = 1 << 0,
    RCC_APB1ENR_TIM3 = 1 << 1,
    RCC_APB1ENR_TIM4 = 1 << 2,
    RCC_APB1ENR_TIM5 = 1 << 3,
    RCC_APB1ENR_WWDG = 1 << 11,
    RCC_APB1ENR_SPI2 = 1 << 14,
    RCC_APB1ENR_SPI3 = 1 << 15,
    RCC_APB1ENR_USART3 = 1 << 18,
    RCC_APB1ENR_CAN1 = 1 << 25,
    RCC_APB1ENR_PWR = 1 << 28,
    RCC_APB1ENR_DAC = 1 << 29,
    RCC_APB2ENR_TIM1 = 1 << 0,
    RCC_APB2ENR_TIM8 = 1 << 1,
    RCC_APB2ENR_USART1 = 1 << 4,
    RCC_CSR_RMVF = 1 << 24,
    RCC_CSR_BORRSTF = 1 << 25,
    RCC_CSR_PINRSTF = 1 << 26,
    RCC_CSR_PORRSTF = 1 << 27,
    RCC_CSR_SFTRSTF = 1 << 28,
    RCC_CSR_IWDGRSTF = 1 << 29,
    RCC_CSR_WWDGRSTF = 1 << 30,
};

/* RM0090 5.4 (PWR of the F405) */
struct pwr {
    reg CR, CSR;
};
enum { PWR_CR_PVDE = 1 << 4, PWR_CR_PLS_2V8 = 6 << 5, PWR_CR_VOS = 1 << 14, PWR_CSR_PVDO = 1 << 2 };

/* RM0090 12.3 (EXTI); line 16 is the voltage detector's (12.2.5) */
struct exti {
    reg IMR, EMR, RTSR, FTSR, SWIER, PR;
};
enum { EXTI_PVD = 1 << 16 };

/* RM0090 3.9 (flash interface) */
struct flash {
    reg ACR, KEYR, OPTKEYR, SR, CR, OPTCR;
};
#define FLASH_KEY1 0x45670123u
#define FLASH_KEY2 0xCDEF89ABu
#define FLASH_CR_LOCK (1u << 31)
enum {
    FLASH_ACR_LATENCY = 7,
    FLASH_ACR_PRFTEN = 1 << 8,
    FLASH_ACR_ICEN = 1 << 9,
    FLASH_ACR_DCEN = 1 << 10,
    FLASH_ACR_DCRST = 1 << 12,
    FLASH_SR_EOP = 1 << 0,
    FLASH_SR_OPERR = 1 << 1,
    FLASH_SR_WRPERR = 1 << 4,
    FLASH_SR_PGAERR = 1 << 5,
    FLASH_SR_PGPERR = 1 << 6,
    FLASH_SR_PGSERR = 1 << 7,
    FLASH_SR_BSY = 1 << 16,
    FLASH_CR_PG = 1 << 0,
    FLASH_CR_SER = 1 << 1,
    FLASH_CR_SNB = 3,
    FLASH_CR_PSIZE_32 = 2 << 8,
    FLASH_CR_STRT = 1 << 16,
};

/* RM0090 8.4 (GPIO): ports A..I */
struct gpio {
    reg MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFR[2];
};

/* RM0090 17.4 (TIM1 and TIM8) and 18.4 (TIM2 to TIM5), which have the same layout */
struct tim {
    reg CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR[4], BDTR, DCR, DMAR, OR;
};
enum {
    TIM_CR1_CEN = 1 << 0,
    TIM_CR1_UDIS = 1 << 1,
    TIM_CR1_ARPE = 1 << 7,
    TIM_SMCR_ENCODER_BOTH = 3, /* SMS = 011: counts on both edges of TI1 and TI2 */
    TIM_SR_CC1IF = 1 << 1,     /* CCxIF follow */
    TIM_SR_BIF = 1 << 7,
    TIM_EGR_UG = 1 << 0,
    TIM_CCMR_INPUT = 1,              /* CCxS = 01: ICx is TIx; of the channel's byte of CCMR1, CCMR2 */
    TIM_CCMR_IC_FILTER = 4,          /* position of ICxF in that byte */
    TIM_CCMR_PWM1 = 6 << 4 | 1 << 3, /* OCxM = 110, OCxPE */
    TIM_CCMR_PWM1_AT_ONCE = 6 << 4,  /* without preload */
    TIM_CCER_E = 1 << 0,             /* of the channel's four bits */
    TIM_BDTR_OSSI = 1 << 10,
    TIM_BDTR_OSSR = 1 << 11,
    TIM_BDTR_BKE = 1 << 12,
    TIM_BDTR_BKP = 1 << 13, /* the break input is active high */
    TIM_BDTR_MOE = 1 << 15,
};

/* RM0090 14 (DAC) */
struct dac {
    reg CR, SWTRIGR, DHR12R1, DHR12L1, DHR8R1, DHR12R2, DHR12L2, DHR8R2, DHR12RD, DHR12LD, DHR8RD, DOR1, DOR2, SR;
};
enum { DAC_CR_EN1 = 1 << 0, DAC_CR_BOFF1 = 1 << 1, DAC_CR_EN2 = 1 << 16, DAC_CR_BOFF2 = 1 << 17 };

/* RM0090 28.5 (SPI) */
struct spi {
    reg CR1, CR2, SR, DR;
};
enum {
    SPI_CR1_CPHA = 1 << 0,
    SPI_CR1_MSTR = 1 << 2,
    SPI_CR1_SPE = 1 << 6,
    SPI_CR1_SSI = 1 << 8,
    SPI_CR1_SSM = 1 << 9,
    SPI_CR1_BIDIOE = 1 << 14,
    SPI_CR1_BIDIMODE = 1 << 15,
    SPI_SR_TXE = 1 << 1,
    SPI_SR_BSY = 1 << 7,
};

/* RM0090 30.6 (USART) */
struct usart {
    reg SR, DR, BRR, CR1, CR2, CR3, GTPR;
};
enum {
    USART_SR_FE = 1 << 1,
    USART_SR_NF = 1 << 2,
    USART_SR_ORE = 1 << 3,
    USART_SR_RXNE = 1 << 5,
    USART_SR_TXE = 1 << 7,
    USART_CR1_RE = 1 << 2,
    USART_CR1_TE = 1 << 3,
    USART_CR1_RXNEIE = 1 << 5,
    USART_CR1_TXEIE = 1 << 7,
    USART_CR1_UE = 1 << 13,
};

/* RM0090 32.9 (bxCAN) */
struct can_mailbox {
    reg IR, DTR, DLR, DHR; /* TIxR TDTxR TDLxR TDHxR, RIxR RDTxR RDLxR RDHxR */
};
struct can {
    reg MCR, MSR, TSR, RF0R, RF1R, IER, ESR, BTR, unused_20[88];
    struct can_mailbox TX[3], RX[2];
    reg unused_1d0[12], FMR, FM1R, unused_208, FS1R, unused_210, FFA1R, unused_218, FA1R, unused_220[8], FR[28][2];
};
enum {
    CAN_MCR_INRQ = 1 << 0,
    CAN_MCR_TXFP = 1 << 2,
    CAN_MCR_ABOM = 1 << 6,
    CAN_MSR_INAK = 1 << 0,
    CAN_MSR_ERRI = 1 << 2,
    CAN_TSR_RQCP0 = 1 << 0,
    CAN_TSR_RQCP1 = 1 << 8,
    CAN_TSR_RQCP2 = 1 << 16,
    CAN_TSR_ABRQ0 = 1 << 7,
    CAN_TSR_ABRQ1 = 1 << 15,
    CAN_TSR_ABRQ2 = 1 << 23,
    CAN_TSR_TME0 = 1 << 26, /* TME1, TME2 follow */
    CAN_RF0R_FMP = 3,
    CAN_RF0R_FOVR = 1 << 4,
    CAN_RF0R_RFOM = 1 << 5,
    CAN_IER_TMEIE = 1 << 0,
    CAN_IER_FMPIE0 = 1 << 1,
    CAN_IER_FOVIE0 = 1 << 3,
    CAN_IER_BOFIE = 1 << 10,
    CAN_IER_ERRIE = 1 << 15,
    CAN_ESR_EWGF = 1 << 0,
    CAN_ESR_EPVF = 1 << 1,
    CAN_ESR_BOFF = 1 << 2,
    CAN_ESR_TEC = 16,
    CAN_ESR_REC = 24,
    CAN_BTR_TS1 = 16,
    CAN_BTR_TS2 = 20,
    CAN_BTR_SJW = 24,
    CAN_IR_TXRQ = 1 << 0,
    CAN_IR_RTR = 1 << 1,
    CAN_IR_IDE = 1 << 2,
    CAN_IR_STID = 21,
    CAN_FMR_FINIT = 1 << 0,
};

/* RM0090 21.4 (IWDG) */
struct iwdg {
    reg KR, PR, RLR, SR;
};
enum { IWDG_KEY_FEED = 0xAAAA, IWDG_KEY_ACCESS = 0x5555, IWDG_KEY_START = 0xCCCC, IWDG_SR_PVU = 1, IWDG_SR_RVU = 2 };

/* RM0090 22.6 (WWDG) */
struct wwdg {
    reg CR, CFR, SR;
};
enum { WWDG_CR_WDGA = 1 << 7, WWDG_CR_T6 = 1 << 6, WWDG_CFR_W = 0x7F };

/* RM0090 38.16 (DBGMCU) */
struct dbgmcu {
    reg IDCODE, CR, APB1_FZ, APB2_FZ;
};
enum {
    DBGMCU_APB1_FZ_WWDG = 1 << 11,
    DBGMCU_APB1_FZ_IWDG = 1 << 12,
    DBGMCU_APB2_FZ_TIM1 = 1 << 0,
    DBGMCU_APB2_FZ_TIM8 = 1 << 1,
};
#define DBGMCU_IDCODE_REV 0xFFFF0000u
#define DBGMCU_IDCODE_REV_A 0x10000000u

/* DDI 0403E B3.3 (SysTick) */
struct systick {
    reg CTRL, LOAD, VAL, CALIB;
};
enum { SYSTICK_ENABLE = 1 << 0, SYSTICK_TICKINT = 1 << 1, SYSTICK_CORE_CLOCK = 1 << 2 };

/* DDI 0403E B3.2 (system control block) */
struct scb {
    reg CPUID, ICSR, VTOR, AIRCR, SCR, CCR, SHPR[3], SHCSR, CFSR, HFSR, DFSR, MMFAR, BFAR, AFSR, unused_40[18], CPACR;
};
enum {
    SCB_ICSR_PENDSTSET = 1 << 26,
    SCB_AIRCR_SYSRESETREQ = 1 << 2,
    SCB_AIRCR_KEY = 0x05FA0000,
    SCB_CCR_DIV_0_TRP = 1 << 4,
    SCB_CPACR_FPU = 15 << 20,
};

/* DDI 0403E C1.6 (debug exception and monitor control), C1.8 (DWT) */
struct debug {
    reg DHCSR, DCRSR, DCRDR, DEMCR;
};
enum { DEBUG_DEMCR_TRCENA = 1 << 24 };
struct dwt {
    reg CTRL, CYCCNT;
};
enum { DWT_CTRL_CYCCNTENA = 1 << 0 };

/* DDI 0403E B3.4 (NVIC): ISER at E000E100h, ICER at 180h, ISPR at 200h, IPR at 400h (a byte each, four in a word) */
struct nvic {
    reg ISER[8], unused_20[24], ICER[8], unused_a0[24], ISPR[8], unused_120[120], IPR[60];
};
/* Interrupt numbers: RM0090 12, vector table of the STM32F405 */
enum { IRQ_PVD = 1, IRQ_CAN1_TX = 19, IRQ_CAN1_RX0 = 20, IRQ_CAN1_SCE = 22, IRQ_USART1 = 37, IRQ_USART3 = 39 };

/* Of the F405: 0 to 81 */
enum { IRQS = 82, GPIO_PORTS = 9 };

/* A field at the wrong offset would be a bug that only a board shows. */
_Static_assert(offsetof(struct rcc, AHB1ENR) == 0x30 && offsetof(struct rcc, CSR) == 0x74, "RM0090 7.3");
_Static_assert(offsetof(struct gpio, BSRR) == 0x18 && offsetof(struct gpio, AFR) == 0x20, "RM0090 8.4");
_Static_assert(offsetof(struct tim, CNT) == 0x24 && offsetof(struct tim, CCR) == 0x34 &&
                   offsetof(struct tim, BDTR) == 0x44,
               "RM0090 17.4");
_Static_assert(offsetof(struct dac, DHR12RD) == 0x20 && offsetof(struct dac, DOR1) == 0x2C, "RM0090 14");
_Static_assert(offsetof(struct can, TX) == 0x180 && offsetof(struct can, RX) == 0x1B0 &&
                   offsetof(struct can, FMR) == 0x200 && offsetof(struct can, FA1R) == 0x21C &&
                   offsetof(struct can, FR) == 0x240,
               "RM0090 32.9");
_Static_assert(offsetof(struct scb, SHPR) == 0x18 && offsetof(struct scb, CFSR) == 0x28 &&
                   offsetof(struct scb, BFAR) == 0x38 && offsetof(struct scb, CPACR) == 0x88,
               "DDI 0403E B3.2");
_Static_assert(offsetof(struct nvic, ICER) == 0x80 && offsetof(struct nvic, ISPR) == 0x100 &&
                   offsetof(struct nvic, IPR) == 0x300,
               "DDI 0403E B3.4");

#ifdef __arm__
#define KONTUR_REGS(type, address, field) ((struct type *)(address))
#else
struct chip {
    struct rcc rcc;
    struct pwr pwr;
    struct exti exti;
    struct flash flash;
    struct gpio gpio[GPIO_PORTS];
    struct tim tim1, tim2, tim3, tim4, tim5, tim8;
    struct dac dac;
    struct spi spi2, spi3;
    struct usart usart1, usart3;
    struct can can1;
    struct iwdg iwdg;
    struct wwdg wwdg;
    struct dbgmcu dbgmcu;
    struct systick systick;
    struct scb scb;
    struct debug debug;
    struct dwt dwt;
    struct nvic nvic;
};
extern struct chip chip;
#define KONTUR_REGS(type, address, field) (&chip.field)
#endif

/* Addresses: RM0090 2.3, register boundary addresses */
#define TIM2 KONTUR_REGS(tim, 0x40000000u, tim2)
#define TIM3 KONTUR_REGS(tim, 0x40000400u, tim3)
#define TIM4 KONTUR_REGS(tim, 0x40000800u, tim4)
#define TIM5 KONTUR_REGS(tim, 0x40000C00u, tim5)
#define WWDG KONTUR_REGS(wwdg, 0x40002C00u, wwdg)
#define IWDG KONTUR_REGS(iwdg, 0x40003000u, iwdg)
#define SPI2 KONTUR_REGS(spi, 0x40003800u, spi2)
#define SPI3 KONTUR_REGS(spi, 0x40003C00u, spi3)
#define USART3 KONTUR_REGS(usart, 0x40004800u, usart3)
#define CAN1 KONTUR_REGS(can, 0x40006400u, can1)
#define PWR KONTUR_REGS(pwr, 0x40007000u, pwr)
#define DAC KONTUR_REGS(dac, 0x40007400u, dac)
#define TIM1 KONTUR_REGS(tim, 0x40010000u, tim1)
#define TIM8 KONTUR_REGS(tim, 0x40010400u, tim8)
#define USART1 KONTUR_REGS(usart, 0x40011000u, usart1)
#define EXTI KONTUR_REGS(exti, 0x40013C00u, exti)
#define RCC KONTUR_REGS(rcc, 0x40023800u, rcc)
#define FLASH KONTUR_REGS(flash, 0x40023C00u, flash)
#define DBGMCU KONTUR_REGS(dbgmcu, 0xE0042000u, dbgmcu)
#define DWT KONTUR_REGS(dwt, 0xE0001000u, dwt)
#define SYSTICK KONTUR_REGS(systick, 0xE000E010u, systick)
#define NVIC KONTUR_REGS(nvic, 0xE000E100u, nvic)
#define SCB KONTUR_REGS(scb, 0xE000ED00u, scb)
#define DEBUG KONTUR_REGS(debug, 0xE000EDF0u, debug)
#ifdef __arm__
#define GPIO(port) ((struct gpio *)(0x40020000u + 0x400u * (port)))
#else
#define GPIO(port) (&chip.gpio[port])
#endif
#endif
