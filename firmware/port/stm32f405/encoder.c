/* SPDX-License-Identifier: Apache-2.0 */
/* encoder.c: the encoder timers, encoder.h. */
#include "port/stm32f405/encoder.h"

#include <stddef.h>

#include "port/stm32f405/board.h"
#include "port/stm32f405/cpu.h"

enum { LINE = 4 };

struct encoder_input {
    bool running; /* false in an emulator, because QEMU's timers lack the encoder mode and count time */
    bool invert;
    bool paused;     /* since the last read */
    bool index_seen; /* index_count belongs to a pulse since the last encoder_configure() */
    uint32_t index_counts, jump_counts;
    uint32_t last; /* the timer's counter at the last read */
    uint32_t count;
    uint8_t index_pulses;
    uint32_t index_count;
};

static const struct board_axis axes[AXES] = {BOARD_X, BOARD_Y};
static struct encoder_input encoders[AXES], seconds[AXES];

/* to - from, modulo the range of the timer: the shorter of the two ways. */
static int32_t difference(const struct board_encoder *board, uint32_t to, uint32_t from)
{
    const uint32_t d = to - from;
    return board->top == 0xFFFFu ? (int16_t)(uint16_t)d : (int32_t)d;
}

static struct encoder_input start(const struct board_encoder *b)
{
    struct tim *tim = b->tim;
    RCC->APB1ENR |= b->apb1;
    (void)RCC->APB1ENR;
    pin_setup(b->a, PIN_ALTERNATE, PIN_PULL_UP, b->alternate);
    pin_setup(b->b, PIN_ALTERNATE, PIN_PULL_UP, b->alternate);
    pin_setup(b->index, PIN_ALTERNATE, PIN_PULL_DOWN, b->alternate);
    /* ICxF = 0010 filters the inputs over 4 clocks of 84 MHz, 48 ns: edges of up to 10 MHz pass. */
    const uint32_t input = TIM_CCMR_INPUT | 2u << TIM_CCMR_IC_FILTER;
    tim->ARR = b->top;
    tim->CCMR1 = input | input << 8;
    tim->CCMR2 = input | input << 8;
    tim->CCER = b->index == PIN_NONE ? 0u : (uint32_t)TIM_CCER_E << 4 * (b->index_channel - 1u);
    tim->SMCR = TIM_SMCR_ENCODER_BOTH;
    tim->EGR = TIM_EGR_UG;
    tim->SR = 0;
    tim->CR1 = TIM_CR1_CEN;
    return (struct encoder_input){.running = !cpu_emulated(), .jump_counts = UINT32_MAX, .last = tim->CNT};
}

void encoder_init(void)
{
    for (int i = 0; i < AXES; i++) {
        encoders[i] = start(&axes[i].encoder);
        if (axes[i].second.tim != NULL) {
            seconds[i] = start(&axes[i].second);
        }
    }
}

void encoder_configure(const struct hal_axis_cfg cfg[AXES])
{
    for (int i = 0; i < AXES; i++) {
        const uint32_t lock = cpu_lock();
        encoders[i].invert = cfg[i].invert_encoder;
        encoders[i].index_counts = cfg[i].index_counts;
        encoders[i].jump_counts = cfg[i].jump_counts;
        encoders[i].index_seen = false;
        seconds[i].invert = cfg[i].invert_second;
        cpu_unlock(lock);
    }
}

static uint32_t magnitude(int32_t x)
{
    return x < 0 ? 0u - (uint32_t)x : (uint32_t)x;
}

/* Take over an index pulse at `count`. Returns whether it is a multiple of index_counts from the last one. */
static bool index_plausible(struct encoder_input *e, uint32_t count)
{
    bool plausible = true;
    if (e->index_seen && e->index_counts != 0) {
        const uint32_t off = magnitude((int32_t)(count - e->index_count)) % e->index_counts;
        plausible = off <= LINE || e->index_counts - off <= LINE;
    }
    e->index_seen = true;
    e->index_count = count;
    e->index_pulses++;
    return plausible;
}

/* Take over the timer's counter, `now`. Returns whether the count is plausible. */
static bool update(struct encoder_input *e, const struct board_encoder *board, uint32_t now)
{
    const struct tim *tim = board->tim;
    const int32_t moved = difference(board, now, e->last);
    bool good = magnitude(moved) <= e->jump_counts || e->paused;
    e->paused = false;
    e->last = now;
    e->count += (uint32_t)(e->invert ? -moved : moved);
    if (board->index != PIN_NONE && (tim->SR & (uint32_t)TIM_SR_CC1IF << (board->index_channel - 1u)) != 0) {
        /* Reading CCR clears the flag. */
        const int32_t since = difference(board, now, tim->CCR[board->index_channel - 1u]);
        good = index_plausible(e, e->count - (uint32_t)(e->invert ? -since : since)) && good;
    }
    return good;
}

/* Second encoders have no index pulse, and a count that is wrong shows in their difference to the first one. */
static void read_second(struct hal_drive_in *in, int i)
{
    struct encoder_input *e = &seconds[i];
    if (e->running) {
        (void)update(e, &axes[i].second, axes[i].second.tim->CNT);
    }
    in->second[i] = (int32_t)e->count;
}

void encoder_paused(void)
{
    for (int i = 0; i < AXES; i++) {
        encoders[i].paused = axes[i].encoder.top == 0xFFFFFFFFu;
    }
}

void encoder_read(struct hal_drive_in *in)
{
    const uint32_t now[AXES] = {axes[AXIS_X].encoder.tim->CNT, axes[AXIS_Y].encoder.tim->CNT};
    for (int i = 0; i < AXES; i++) {
        struct encoder_input *e = &encoders[i];
        if (e->running && !update(e, &axes[i].encoder, now[i])) {
            in->inputs[i] |= HAL_ENCODER_FAULT;
        }
        in->count[i] = (int32_t)e->count;
        in->index_pulses[i] = e->index_pulses;
        in->index_count[i] = (int32_t)e->index_count;
        read_second(in, i);
    }
}
