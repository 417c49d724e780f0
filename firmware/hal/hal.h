/* SPDX-License-Identifier: Apache-2.0 */
/* hal.h: the hardware abstraction layer, which is what the hardware, real or simulated, offers the firmware.
 *
 * A port fills one `const struct hal`. Each function gets `ctx` as
 * its first argument. No function blocks, except for the flash.
 *
 * Context: the servo tick calls drive_read and drive_write; the background loop calls the other functions.
 */
#ifndef KONTUR_HAL_H
#define KONTUR_HAL_H
#include <stdbool.h>
#include <stdint.h>

/* Control periods (servo ticks) in a second: a multiple of 1000, chosen when the firmware is compiled. */
#ifndef CONTROL_HZ
#define CONTROL_HZ 10000u
#endif

enum { AXIS_X = 0, AXIS_Y = 1, AXES = 2 };

/* One classic CAN frame with an 11-bit identifier. */
struct can_frame {
    uint16_t id; /* 0..7FFh */
    uint8_t len; /* 0..8 */
    bool rtr;
    uint8_t data[8];
};

/* Inputs of an axis. The limit switches have the bits that
 * they have in 60FDh. A 1 means active, whatever the wiring. */
enum hal_input {
    HAL_LIMIT_MIN = 1, /* limit switch at the lower end */
    HAL_LIMIT_MAX = 2, /* limit switch at the upper end */
    HAL_AMPLIFIER_FAULT = 16,
    HAL_ENCODER_FAULT = 32, /* an illegal transition of A and B since the last read */
    HAL_STOP = 64,          /* emergency stop, the same on both axes */
};

struct hal_drive_in {
    int32_t count[AXES];        /* encoder position in counts since power-on; wraps as int32 does */
    int32_t second[AXES];       /* the same of a second encoder; 0 where there is none */
    uint8_t inputs[AXES];       /* enum hal_input */
    uint8_t index_pulses[AXES]; /* index pulses since power-on, modulo 256 */
    int32_t index_count[AXES];  /* `count` at the last index pulse */
};

struct hal_drive_out {
    int32_t force_mN[AXES]; /* force for the next control period, within the axis's force limit */
    bool enable[AXES];      /* power stage on */
    bool release[AXES];     /* brake released; never without `enable` */
    uint16_t digital;       /* outputs beside the axes, bits 0 to 11; 0: all off */
    uint16_t power;         /* analog output beside the axes, 1/65535 of its range; 0: off */
};

enum hal_can_state { HAL_CAN_ACTIVE, HAL_CAN_WARNING, HAL_CAN_PASSIVE, HAL_CAN_OFF };

struct hal_can_status {
    enum hal_can_state state;
    uint8_t tx_errors, rx_errors; /* error counters of the controller */
    uint32_t rx_lost;             /* frames lost because there was no room for them, since power-on */
    uint32_t bus_offs;            /* since power-on */
};

/* How an axis is wired (2104h, 210Ah:4). */
enum hal_output { HAL_OUTPUT_DAC, HAL_OUTPUT_PWM, HAL_OUTPUT_SPI_DAC };
enum { HAL_FULL_SCALE_MIN = 10000 };
struct hal_axis_cfg {
    enum hal_output output;
    uint32_t full_scale_mN; /* force at the end of the output's range; at least HAL_FULL_SCALE_MIN */
    int16_t offset;         /* that of the analog command, 1e-5 of full scale: 0.1 mV of 10 V */
    struct hal_pwm_cfg {    /* the same for both axes */
        uint32_t hz;        /* 3000..100000 */
        bool antiphase;     /* no force is the middle of the two duties, and there is no direction */
        uint16_t duty_min;  /* 1/1000: 0..450, at no force or, in antiphase, at the largest negative one */
        uint16_t duty_max;  /* 1/1000: 550..1000, at full force */
    } pwm;
    bool invert_force, invert_encoder, invert_second;
    uint32_t index_counts; /* encoder counts between two index pulses; 0: not checked */
    uint32_t jump_counts;  /* more counts than this in one control period are an encoder fault */
};

/* Faults of the controller itself, one bit each. */
enum hal_health_bit {
    HAL_CLOCK = 1, /* it runs on its internal oscillator, since the crystal has not started or has stopped */
    HAL_RESET = 2, /* the watchdog, a crash or a brown-out ended the last run; `reset` says which */
};
enum hal_reset {
    HAL_RESET_UNKNOWN,
    HAL_RESET_POWER,
    HAL_RESET_PIN,
    HAL_RESET_SOFTWARE,
    HAL_RESET_WATCHDOG,
    HAL_RESET_CRASH,
    HAL_RESET_BROWN_OUT
};

/* The last crash since power-on: the registers of the processor
 * (ARMv7-M) when it happened, and the number of crashes. */
struct hal_crash {
    uint32_t pc, lr, psr, cfsr, hfsr, bfar, count;
};
struct hal_health {
    uint8_t bits;         /* enum hal_health_bit */
    enum hal_reset reset; /* why the processor has started */
    struct hal_crash crash;
    uint32_t tick_cycles,
        tick_cycles_worst; /* processor's cycles of a servo tick, the last and since the start; 0: not counted */
};

/* The parameter store. A sector is erased completely (to FFh), and written in words, each of them once. */
enum { HAL_FLASH_SECTORS = 2, HAL_FLASH_BYTES = 16384 };

struct hal {
    void *ctx;
    /* Sample all encoders at one instant, and the inputs. */
    void (*drive_read)(void *ctx, struct hal_drive_in *in);
    /* Put out both forces at one instant. */
    void (*drive_write)(void *ctx, const struct hal_drive_out *out);
    /* Set the wiring; no axis has power. May be NULL. */
    void (*drive_configure)(void *ctx, const struct hal_axis_cfg cfg[AXES]);
    /* Queue a frame for sending. false: there is no room, the frame is dropped, and the caller may try again. */
    bool (*can_send)(void *ctx, const struct can_frame *frame);
    /* Take the oldest frame received. false: there is none. */
    bool (*can_receive)(void *ctx, struct can_frame *frame);
    /* The state of the CAN controller. */
    void (*can_status)(void *ctx, struct hal_can_status *status);
    /* Whether the port supports this bit rate. With `change` it sets it, and drops the frames that wait to be sent. */
    bool (*can_bitrate)(void *ctx, uint16_t kbitps, bool change);
    /* Read `bytes` at `offset` of a sector. Offsets and lengths are multiples of 4. */
    void (*flash_read)(void *ctx, unsigned sector, uint32_t offset, void *data, uint32_t bytes);
    /* Erase a sector, and write to it. Both may stop the processor, servo tick included, for as long as the flash
     * takes, so they are called only without power on an axis. false: the flash reports an error. */
    bool (*flash_erase)(void *ctx, unsigned sector);
    bool (*flash_write)(void *ctx, unsigned sector, uint32_t offset, const void *data, uint32_t bytes);
    /* A number that cannot be foretold, such as the place of a fast counter: tickets are drawn with it. May be NULL:
     * the drive's time alone tells them apart. */
    uint32_t (*entropy)(void *ctx);
    /* The health of the controller itself. May be NULL: it has no faults. */
    void (*health)(void *ctx, struct hal_health *health);
};
#endif
