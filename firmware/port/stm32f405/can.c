/* SPDX-License-Identifier: Apache-2.0 */
/* can.c: the driver of bxCAN 1, can.h. */
#include "port/stm32f405/can.h"

#include <stdatomic.h>

#include "port/stm32f405/board.h"
#include "port/stm32f405/cpu.h"

enum { RX_ROOM = 64, TX_ROOM = 32, MAILBOXES = 3, POLLS = 100000, RELEASE_POLLS = 100 };

/* A ring with one writer and one reader. Its positions count frames since power-on. */
struct ring {
    struct can_frame *frame;
    uint32_t room; /* a power of two */
    _Atomic uint32_t in, out;
};

struct timing {
    uint16_t kbitps;
    uint8_t prescaler, segment1, segment2; /* time quanta: 1 + segment1, sample point, segment2 */
};
static const struct timing timings[] = {{1000, 3, 11, 2}, {500, 6, 11, 2}, {250, 21, 6, 1}, {125, 21, 13, 2}};

static struct can_frame rx_frames[RX_ROOM], tx_frames[TX_ROOM];
static struct ring rx = {.frame = rx_frames, .room = RX_ROOM};
static struct ring tx = {.frame = tx_frames, .room = TX_ROOM};
static _Atomic uint32_t rx_lost, bus_offs;
static bool running;

static bool push(struct ring *r, const struct can_frame *frame)
{
    const uint32_t in = atomic_load(&r->in);
    if (in - atomic_load(&r->out) == r->room) {
        return false;
    }
    r->frame[in % r->room] = *frame;
    atomic_store(&r->in, in + 1u);
    return true;
}

static bool pop(struct ring *r, struct can_frame *frame)
{
    const uint32_t out = atomic_load(&r->out);
    if (out == atomic_load(&r->in)) {
        return false;
    }
    *frame = r->frame[out % r->room];
    atomic_store(&r->out, out + 1u);
    return true;
}

static const struct timing *timing_of(uint16_t kbitps)
{
    for (size_t i = 0; i < sizeof timings / sizeof timings[0]; i++) {
        if (timings[i].kbitps == kbitps) {
            return &timings[i];
        }
    }
    return NULL;
}

/* RM0090 32.4.1: the bit timing can be written in initialisation mode only. The controller enters that mode after
 * a frame that is being received has ended. */
static bool set_timing(const struct timing *t)
{
    CAN1->MCR = CAN_MCR_INRQ | CAN_MCR_TXFP | CAN_MCR_ABOM; /* also wakes it up; TXFP: send in the order of requests */
    if (!wait_until(&CAN1->MSR, CAN_MSR_INAK, CAN_MSR_INAK, POLLS)) {
        return false;
    }
    const uint32_t jump = t->segment2; /* the longest that segment 2 allows */
    CAN1->BTR = (t->prescaler - 1u) | (t->segment1 - 1u) << CAN_BTR_TS1 | (t->segment2 - 1u) << CAN_BTR_TS2 |
                (jump - 1u) << CAN_BTR_SJW;
    CAN1->MCR &= ~(uint32_t)CAN_MCR_INRQ; /* it joins the bus after 11 recessive bits, without a wait here */
    return true;
}

/* One filter bank passes data frames with 11-bit identifiers: IDE and RTR must be 0. */
static void set_filter(void)
{
    CAN1->FMR |= CAN_FMR_FINIT;
    CAN1->FM1R = 0; /* mask */
    CAN1->FS1R = 1; /* 32 bits */
    CAN1->FFA1R = 0;
    CAN1->FR[0][0] = 0;
    CAN1->FR[0][1] = CAN_IR_IDE | CAN_IR_RTR;
    CAN1->FA1R = 1;
    CAN1->FMR &= ~(uint32_t)CAN_FMR_FINIT;
}

static bool configure(const struct timing *t)
{
    running = t != NULL && set_timing(t);
    if (running) {
        set_filter();
        CAN1->IER = CAN_IER_TMEIE | CAN_IER_FMPIE0 | CAN_IER_FOVIE0 | CAN_IER_BOFIE | CAN_IER_ERRIE;
        cpu_irq_enable(IRQ_CAN1_TX, PRIORITY_CAN);
        cpu_irq_enable(IRQ_CAN1_RX0, PRIORITY_CAN);
        cpu_irq_enable(IRQ_CAN1_SCE, PRIORITY_CAN);
    }
    return running;
}

static void discard_pending(void)
{
    atomic_store(&tx.out, atomic_load(&tx.in));
}

bool can_init(uint16_t kbitps)
{
    const struct timing *t = timing_of(kbitps);
    RCC->APB1ENR |= RCC_APB1ENR_CAN1;
    (void)RCC->APB1ENR;
    pin_setup(BOARD_CAN_RX, PIN_ALTERNATE, PIN_PULL_UP, BOARD_CAN_AF);
    pin_setup(BOARD_CAN_TX, PIN_ALTERNATE, PIN_PULL_UP, BOARD_CAN_AF);
    atomic_store(&rx.out, atomic_load(&rx.in));
    discard_pending();
    return configure(t);
}

bool can_bitrate(uint16_t kbitps, bool change)
{
    const struct timing *t = timing_of(kbitps);
    if (t == NULL || !change) {
        return t != NULL;
    }
    const uint32_t lock = cpu_lock();
    discard_pending();
    CAN1->TSR = CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2;
    cpu_unlock(lock);
    return configure(t);
}

bool can_send(const struct can_frame *frame)
{
    if (!running) {
        return true; /* dropped: it could never be sent, and the caller would try again */
    }
    if (!push(&tx, frame)) {
        return false;
    }
    NVIC->ISPR[IRQ_CAN1_TX / 32] = 1u << IRQ_CAN1_TX % 32;
    return true;
}

bool can_receive(struct can_frame *frame)
{
    return pop(&rx, frame);
}

static void write_mailbox(struct can_mailbox *mailbox, const struct can_frame *f)
{
    const uint8_t *d = f->data;
    mailbox->DTR = f->len;
    mailbox->DLR = d[0] | (uint32_t)d[1] << 8 | (uint32_t)d[2] << 16 | (uint32_t)d[3] << 24;
    mailbox->DHR = d[4] | (uint32_t)d[5] << 8 | (uint32_t)d[6] << 16 | (uint32_t)d[7] << 24;
    mailbox->IR = (uint32_t)f->id << CAN_IR_STID | (f->rtr ? (uint32_t)CAN_IR_RTR : 0u) | CAN_IR_TXRQ;
}

void can_tx_irq(void)
{
    const uint32_t tsr = CAN1->TSR;
    /* A flag that is set after tsr was read stays set and calls the interrupt again. */
    clear_flags(&CAN1->TSR, tsr & (CAN_TSR_RQCP0 | CAN_TSR_RQCP1 | CAN_TSR_RQCP2));
    if ((CAN1->ESR & CAN_ESR_BOFF) != 0) {
        discard_pending(); /* the frames would be out of date when the bus is back */
        return;
    }
    for (unsigned i = 0; i < MAILBOXES; i++) {
        struct can_frame frame;
        if ((tsr & (uint32_t)CAN_TSR_TME0 << i) != 0 && pop(&tx, &frame)) {
            write_mailbox(&CAN1->TX[i], &frame);
        }
    }
}

/* RFOM stays set until the mailbox is released (RM0090 32.9.2). Before that, FMP still counts the frame just read. */
static bool frame_waits(void)
{
    return wait_until(&CAN1->RF0R, CAN_RF0R_RFOM, 0, RELEASE_POLLS) && (CAN1->RF0R & CAN_RF0R_FMP) != 0;
}

void can_rx_irq(void)
{
    if ((CAN1->RF0R & CAN_RF0R_FOVR) != 0) {
        clear_flags(&CAN1->RF0R, CAN_RF0R_FOVR);
        atomic_fetch_add(&rx_lost, 1u);
    }
    for (int n = 0; n < 3 && frame_waits(); n++) {
        const struct can_mailbox *mailbox = &CAN1->RX[0];
        const uint32_t id = mailbox->IR, low = mailbox->DLR, high = mailbox->DHR;
        const uint8_t len = (uint8_t)(mailbox->DTR & 15u);
        struct can_frame frame = {
            .id = (uint16_t)(id >> CAN_IR_STID), .len = len < 8 ? len : 8, .rtr = (id & CAN_IR_RTR) != 0};
        for (unsigned i = 0; i < 4; i++) {
            frame.data[i] = (uint8_t)(low >> 8 * i);
            frame.data[4 + i] = (uint8_t)(high >> 8 * i);
        }
        if (!push(&rx, &frame)) {
            atomic_fetch_add(&rx_lost, 1u);
        }
        CAN1->RF0R = CAN_RF0R_RFOM;
    }
}

void can_error_irq(void)
{
    clear_flags(&CAN1->MSR,
                CAN_MSR_ERRI); /* set once when BOFF is set; no interrupt says that it ends (RM0090 32.9.2, IER) */
    if ((CAN1->ESR & CAN_ESR_BOFF) != 0) {
        atomic_fetch_add(&bus_offs, 1u);
        discard_pending(); /* can_tx_irq(), the other reader, has the same priority */
        CAN1->TSR = CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2;
    }
}

void can_status(struct hal_can_status *status)
{
    const uint32_t esr = CAN1->ESR;
    const bool out = (!running && !cpu_emulated()) || (esr & CAN_ESR_BOFF) != 0 || (CAN1->MSR & CAN_MSR_INAK) != 0;
    *status = (struct hal_can_status){
        .state = out                         ? HAL_CAN_OFF
                 : (esr & CAN_ESR_EPVF) != 0 ? HAL_CAN_PASSIVE
                 : (esr & CAN_ESR_EWGF) != 0 ? HAL_CAN_WARNING
                                             : HAL_CAN_ACTIVE,
        .tx_errors = (uint8_t)(esr >> CAN_ESR_TEC),
        .rx_errors = (uint8_t)(esr >> CAN_ESR_REC),
        .rx_lost = atomic_load(&rx_lost),
        .bus_offs = atomic_load(&bus_offs),
    };
}
