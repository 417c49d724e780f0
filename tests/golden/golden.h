/* SPDX-License-Identifier: Apache-2.0 */
/* golden.h: the control core on fixed inputs, word for word. It has no files, libm
 * or heap, so it runs on a microcontroller as well as on a host, and must give the
 * same words on both (golden_f32.h and golden_fix.h, made by write.c).
 *
 * Context: tests/unit/test_golden.c and write.c call it.
 */
#ifndef KONTUR_GOLDEN_H
#define KONTUR_GOLDEN_H
#include <stdint.h>

/* Called for each word of inputs and outputs, in order. `vector` is the name of the vector that the word belongs to. */
typedef void (*golden_put)(void *ctx, const char *vector, uint32_t word);
/* Compute all vectors. */
void golden_run(golden_put put, void *ctx);
#endif
