/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/contour_range.h"

void contour_range_step(struct contour_range *range, bool first, const struct contour_out *c, vec2 apart)
{
    const num error = n_add(c->e_n.y, v2_dot(v2_normal(c->t), apart));
    range->bound[0] = first ? error : n_min(range->bound[0], error);
    range->bound[1] = first ? error : n_max(range->bound[1], error);
}
