/* SPDX-License-Identifier: Apache-2.0 */
/* golden.h: the control core on fixed inputs, word for word. No files, no libm, no heap: runs on a microcontroller as well
 * as on a host, and must give the same words on both (golden_f32.h, golden_fix.h; made by `make golden`). */
#ifndef KONTUR_GOLDEN_H
#define KONTUR_GOLDEN_H
#include <stdint.h>

/* Called for each word, inputs and outputs, in order; `vector`: the name of what it belongs to. */
typedef void (*golden_put)(void *ctx, const char *vector, uint32_t word);
void golden_run(golden_put put, void *ctx);
#endif
