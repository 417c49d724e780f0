/* SPDX-License-Identifier: Apache-2.0 */
/* geometry.h: the position of the tool, from the positions of the encoders. With it the law, the contour error, the
 * limits and the telemetry are about the tool. Of axis i, where j is the other one:
 *
 *   tool_i = encoder_i + lead_i(p_i) + s_j p_j + c_i cos(a_i) + s_i sin(a_i) - F_i / k_i - g_i b_i
 *
 * A second encoder (dual_feedback.h) stands between the terms of angle and force, which lie between both encoders, and
 * the others.
 *
 * | symbol | meaning                                                                            | unit |
 * |--------|------------------------------------------------------------------------------------|------|
 * | p      | user's position of the encoder: its position and the origin that homing has set    | nm   |
 * | lead   | error of the screw: linear between the points of a map, constant beyond its ends   | um   |
 * | s_j    | squareness: share of an axis's travel that is seen on the other axis               | -    |
 * | a      | angle of the screw, 0 at p = 0                                                     |      |
 * | c, s   | error once a turn, of the screw and of the encoder on it                           | um   |
 * | F      | force that the reference needs at the table: m r'' + L d + c r'                    | N    |
 * | d      | direction of the friction, -1..1, as in the force law                              | -    |
 * | m,L,c  | mass and friction beyond the spring                                                |      |
 * | k      | stiffness of the spring between encoder and table                                  | N/um |
 * | g, b   | half of the backlash; the side of the gap to which F pushes, -1..1                 | um,- |
 *
 * The angle goes by p like the map, and not by the encoder, which is 0 wherever its drive was switched on: p belongs to
 * the same angle again as soon as the axis has been homed.
 *
 * The force is that of the reference, because a measured acceleration is noise. Where nothing
 * pushes, b stays. A table for which neither mass nor friction is given is pushed in the direction of motion.
 *
 * The result never steps, since the observer takes a step for a speed. F/k changes by at most GEOMETRY_DEFLECTION_RATE,
 * b follows through a critically damped second-order low-pass whose acceleration needs the force m_0 g b'' of what is
 * before the gap; the caller adds it to that of the law, which need not know of the gap then. Where the origin changes
 * p, the difference to the correction before decays with GEOMETRY_ORIGIN_RATE. The first period after geometry_reset()
 * starts with the whole correction: the caller resets its observers there.
 *
 * Context: servo_step() (servo.c) calls geometry_step() in the servo tick before the observer, and geometry_push() at
 * its end. The axes take turns. Map and squareness are flat, so that they may be older than what goes by the angle.
 *
 * Source: position-dependent compensation as in ISO 230-1:2012, 3.4 (positioning and squareness errors); deflection
 * and lost motion from the reference as in Gross, Hamann, Wiegaertner, Electrical Feed Drives in Automation, 2001.
 */
#ifndef KONTUR_GEOMETRY_H
#define KONTUR_GEOMETRY_H
#include "core/vec2.h"

#define GEOMETRY_POINTS 64u
#define GEOMETRY_DEFLECTION_RATE 10.0 /* um/T0 (2 mm/s): largest rate of a deflection */
#define GEOMETRY_ORIGIN_RATE 1.0      /* um/T0 (0.2 mm/s): rate at which a new origin takes effect */
#define GEOMETRY_SIDE_BANDWIDTH 4.5   /* 1/T0: of the change of side in a gap, at most; 90 % of it take 4.3 ms */
#define GEOMETRY_PUSH_MIN 0.005       /* N: a smaller force does not change the side */
#define GEOMETRY_PUSH 0.01            /* N: force in the direction of motion that decides where no other one does */

struct geometry_axis_cfg {
    uint32_t points;           /* of the map, 2..GEOMETRY_POINTS; 0: none */
    int32_t start_nm;          /* user's position of point 0 */
    uint32_t step_nm;          /* between points, > 0 */
    num lead[GEOMETRY_POINTS]; /* um */
    uint64_t turns;            /* screw_turns() (screw.h); 0: no error once a turn */
    num error_cos, error_sin;  /* c, s, um */
    num squareness;            /* um on the other axis per mm of this one */
    num compliance;            /* 1/k, um/N; 0: rigid */
    num mass;                  /* N T0^2/um */
    num coulomb;               /* N */
    num viscous;               /* N T0/um */
    num half_gap;              /* um */
    num side_bandwidth;        /* 1/T0, 0..GEOMETRY_SIDE_BANDWIDTH */
    num gap_inertia;           /* m_0 g, N T0^2: mass before the gap times half of it; 0: no force */
};

struct geometry_cfg {
    bool on; /* false: geometry_step() need not be called, since the tool is where the encoders are */
    num dt;  /* time between two turns of an axis, T0; of what goes by its position it is twice that */
    struct geometry_axis_cfg axis[2];
};

/* A correction that goes by the user's position. */
struct geometry_placed {
    num placed; /* um */
    num bridge; /* what is left of the difference that the last change of an origin made, um */
};

struct geometry_axis_state {
    int32_t origin_nm;               /* of the last period */
    struct geometry_placed position; /* lead and squareness */
    struct geometry_placed turn;     /* error once a turn */
    num deflection;                  /* F/k, um */
    num target;                      /* side to which F pushed last: -1, 0 (not yet), 1 */
    num side;                        /* b */
    num side_rate;                   /* b', 1/T0 */
    num gap_force;                   /* m_0 g b'', N */
};

struct geometry_state {
    bool started; /* false: geometry_reset() was the last call */
    struct geometry_axis_state axis[2];
    vec2 position; /* the correction by position, um: lead, squareness and bridge */
    vec2 turn;     /* the correction by angle, um, with its bridge */
    vec2 force;    /* the correction by force, um: deflection and backlash */
};

/* Start with side 0 and without a force. */
void geometry_reset(struct geometry_state *state);
/* What goes by position and angle. The tool is at the encoder, moved by state->position, state->turn and state->force.
 * encoder is a position of the servo, and origin_nm is what makes the user's of it. Of four turns, 0 and 1 are those of
 * the angle of axis 0 and 1, and 2 and 3 those of its angle and position; -1 is that of all. Where it starts, or an
 * origin has changed, each turn is. */
void geometry_step(const struct geometry_cfg *cfg, struct geometry_state *state, const pos_t encoder[2],
                   const int32_t origin_nm[2], int turn);
/* What goes by the force, of axis 0 or 1, whose reference has r_dot and r_ddot; 0 without power. direction is that of
 * the reference's friction (smc_direction()). */
void geometry_push(const struct geometry_cfg *cfg, struct geometry_state *state, int axis, num r_dot, num r_ddot,
                   num direction);
#endif
