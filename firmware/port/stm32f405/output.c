/* SPDX-License-Identifier: Apache-2.0 */
/* output.c: the force outputs, output.h. */
#include "port/stm32f405/output.h"

#include "port/stm32f405/board.h"
#include "port/stm32f405/cpu.h"
#include "port/stm32f405/spi_dac.h"
#include "port/stm32f405/switches.h"

enum { DAC_ZERO = 2048, PERMILLE = 1000, OFFSET_ONE = 100000, DEFAULT_PWM_HZ = 40000 };
/* Off: the pins are driven low. */
enum { PWM_OFF = TIM_BDTR_OSSI | TIM_BDTR_OSSR | BOARD_BREAK_BDTR, PWM_ON = PWM_OFF | TIM_BDTR_MOE };

struct channel {
    enum hal_output output;
    bool invert;
    bool antiphase;    /* of PWM: no direction */
    int32_t zero;      /* the output at step 0, in steps */
    int64_t gain;      /* 2^32 steps per mN */
    int32_t offset;    /* 2^-16 steps */
    int32_t low, high; /* steps */
    int32_t error;     /* rounding error of the last step, 2^-16 steps */
};

static const struct board_axis axes[AXES] = {BOARD_X, BOARD_Y};
static struct channel channels[AXES];
static volatile bool safe_state; /* from output_safe() until neither axis is commanded to be enabled */
static bool broken;              /* likewise from a break: the timer holds PWM off */

/* `steps` are full scale, which the step itself reaches in the negative direction only. */
static struct channel analog(int32_t steps, const struct hal_axis_cfg *cfg)
{
    return (struct channel){
        .zero = steps,
        .gain = ((int64_t)steps << 32) / cfg->full_scale_mN,
        .offset = (int32_t)(((int64_t)steps << 16) * cfg->offset / OFFSET_ONE),
        .low = -steps,
        .high = steps - 1,
    };
}

static struct channel pwm(const struct hal_axis_cfg *cfg)
{
    const struct hal_pwm_cfg *p = &cfg->pwm;
    const int32_t period = (int32_t)(CLOCK_HZ / p->hz);
    const int32_t least = period * p->duty_min / PERMILLE;
    const int32_t greatest = period * p->duty_max / PERMILLE;
    const int32_t steps = p->antiphase ? (greatest - least) / 2 : greatest - least;
    return (struct channel){
        .antiphase = p->antiphase,
        .zero = p->antiphase ? least + steps : least,
        .gain = ((int64_t)steps << 32) / cfg->full_scale_mN,
        .low = -steps,
        .high = steps,
    };
}

static void set_channel(struct channel *c, const struct hal_axis_cfg *cfg)
{
    if (cfg->output == HAL_OUTPUT_PWM) {
        *c = pwm(cfg);
    } else {
        *c = analog(cfg->output == HAL_OUTPUT_SPI_DAC ? (int32_t)SPI_DAC_MID_SCALE : DAC_ZERO, cfg);
    }
    c->output = cfg->output;
    c->invert = cfg->invert_force;
}

/* Whether an axis has its command from the serial DAC */
static bool has_spi_dac(void)
{
    return channels[AXIS_X].output == HAL_OUTPUT_SPI_DAC || channels[AXIS_Y].output == HAL_OUTPUT_SPI_DAC;
}

/* A debugger that halts the core stops PWM, unless its pins, which are low then, command a force. */
static void set_timer(const struct hal_pwm_cfg *cfg)
{
    TIM8->ARR = CLOCK_HZ / cfg->hz - 1u;
    if (cfg->antiphase) {
        DBGMCU->APB2_FZ &= ~(uint32_t)DBGMCU_APB2_FZ_TIM8;
    } else {
        DBGMCU->APB2_FZ |= DBGMCU_APB2_FZ_TIM8;
    }
}

void output_init(void)
{
    const struct hal_axis_cfg one = {.full_scale_mN = HAL_FULL_SCALE_MIN, .pwm = {.hz = DEFAULT_PWM_HZ}};
    const struct hal_axis_cfg cfg[AXES] = {one, one};
    for (int i = 0; i < AXES; i++) {
        pin_setup_low(axes[i].enable);
        pin_setup_low(axes[i].brake);
        pin_setup_low(axes[i].direction);
        pin_setup(axes[i].pwm, PIN_ALTERNATE, PIN_PULL_DOWN, BOARD_PWM_AF);
    }
    pin_setup(BOARD_BREAK, PIN_ALTERNATE, PIN_PULL_UP, BOARD_PWM_AF); /* open is a break */
    RCC->APB1ENR |= RCC_APB1ENR_DAC;
    RCC->APB2ENR |= RCC_APB2ENR_TIM8;
    (void)RCC->APB2ENR;
    pin_setup(PIN('A', 4), PIN_ANALOG, PIN_FLOATING, 0); /* before the DAC is on (RM0090 14.2) */
    pin_setup(PIN('A', 5), PIN_ANALOG, PIN_FLOATING, 0);
    DAC->DHR12RD = DAC_ZERO << 16 | DAC_ZERO;
    DAC->CR = DAC_CR_EN1 | DAC_CR_BOFF1 | DAC_CR_EN2 | DAC_CR_BOFF2; /* BOFF: its buffers end 0.2 V before the rails */

    set_timer(&one.pwm);
    TIM8->CCMR1 = TIM_CCMR_PWM1 | TIM_CCMR_PWM1 << 8;
    TIM8->CCR[0] = TIM8->CCR[1] = 0;
    TIM8->CCER = TIM_CCER_E | TIM_CCER_E << 4;
    TIM8->BDTR = PWM_ON;
    safe_state = false;
    broken = false;
    TIM8->EGR = TIM_EGR_UG;
    TIM8->CR1 = TIM_CR1_ARPE | TIM_CR1_CEN;
    spi_dac_init();
    switches_init();
    output_configure(cfg);
}

void output_configure(const struct hal_axis_cfg cfg[AXES])
{
    struct channel next[AXES];
    for (int i = 0; i < AXES; i++) {
        set_channel(&next[i], &cfg[i]);
    }
    const uint32_t lock = cpu_lock();
    set_timer(&cfg[AXIS_X].pwm);
    for (int i = 0; i < AXES; i++) {
        channels[i] = next[i];
    }
    if (has_spi_dac()) { /* its supply may have come later than the chip's */
        spi_dac_configure();
    }
    cpu_unlock(lock);
}

/* The step to put out for a force, with the rounding error of the last step added. */
static int32_t quantise(struct channel *c, int32_t force_mN)
{
    const int64_t exact = (((int64_t)force_mN * c->gain) >> 16) + c->offset + c->error;
    const int64_t step = (exact + 0x8000) >> 16;
    if (step < c->low || step > c->high) {
        c->error = 0;
        return step < 0 ? c->low : c->high;
    }
    c->error = (int32_t)(exact - step * 0x10000);
    return (int32_t)step;
}

void output_read(struct hal_drive_in *in)
{
    if ((TIM8->SR & TIM_SR_BIF) != 0) {
        TIM8->SR = ~(uint32_t)TIM_SR_BIF; /* it comes again as long as the input is active */
        broken = true;
    }
    for (int i = 0; i < AXES; i++) {
        if (broken && channels[i].output == HAL_OUTPUT_PWM) {
            in->inputs[i] |= HAL_AMPLIFIER_FAULT;
        }
    }
}

/* End the safe state, or that of a break, when neither axis is commanded to be enabled. Returns whether the outputs may
 * be written. */
static bool leave_safe_state(const struct hal_drive_out *out)
{
    if (!out->enable[AXIS_X] && !out->enable[AXIS_Y]) {
        TIM8->BDTR = PWM_ON;
        safe_state = false;
        broken = false;
    }
    return !safe_state;
}

static void switch_on(const struct hal_drive_out *out)
{
    for (int i = 0; i < AXES; i++) {
        if (out->enable[i]) {
            pin_write(axes[i].enable, true);
        }
        if (out->release[i]) {
            pin_write(axes[i].brake, true);
        }
    }
    switches_write(out);
}

void output_write(const struct hal_drive_out *out)
{
    uint32_t dac[AXES];
    uint32_t duty[AXES];
    uint32_t serial[AXES];
    if (!leave_safe_state(out)) {
        return;
    }
    for (int i = 0; i < AXES; i++) {
        struct channel *c = &channels[i];
        const int32_t force_mN = out->enable[i] ? out->force_mN[i] : 0;
        c->error = out->enable[i] ? c->error : 0;
        const int32_t step = quantise(c, c->invert ? -force_mN : force_mN);
        const bool backward = c->output == HAL_OUTPUT_PWM && !c->antiphase && step < 0;
        const uint32_t value = (uint32_t)(c->zero + (backward ? -step : step));
        dac[i] = c->output == HAL_OUTPUT_DAC ? value : DAC_ZERO;
        duty[i] = c->output == HAL_OUTPUT_PWM ? value : 0u;
        serial[i] = c->output == HAL_OUTPUT_SPI_DAC ? value : SPI_DAC_MID_SCALE;
        pin_write(axes[i].direction, backward);
        if (!out->release[i]) {
            pin_write(axes[i].brake, false);
        }
        if (!out->enable[i]) {
            pin_write(axes[i].enable, false);
        }
    }
    DAC->DHR12RD = dac[AXIS_Y] << 16 | dac[AXIS_X];
    TIM8->CR1 |= TIM_CR1_UDIS; /* both channels change at one update */
    TIM8->CCR[0] = duty[AXIS_X];
    TIM8->CCR[1] = duty[AXIS_Y];
    TIM8->CR1 &= ~(uint32_t)TIM_CR1_UDIS;
    if (has_spi_dac()) {
        spi_dac_write(serial[AXIS_X], serial[AXIS_Y]);
    }
    if (!safe_state) {
        switch_on(out);
    }
    if (safe_state) { /* an interrupt has called output_safe() meanwhile: it has the last word */
        output_safe();
    }
}

void output_safe(void)
{
    safe_state = true;
    switches_safe();
    for (int i = 0; i < AXES; i++) {
        pin_write(axes[i].brake, false);
        pin_write(axes[i].enable, false);
    }
    DAC->DHR12RD = DAC_ZERO << 16 | DAC_ZERO;
    TIM8->CCR[0] = TIM8->CCR[1] = 0;
    TIM8->BDTR = PWM_OFF;
    if (has_spi_dac()) {
        spi_dac_zero();
    }
}
