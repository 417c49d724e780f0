/* SPDX-License-Identifier: Apache-2.0 */
/* write.c: a program that writes the golden vectors of its back end as a C header. The target `golden` runs it. */
#include <stdio.h>
#include <string.h>

#include "core/num.h"
#include "golden.h"

struct place {
    const char *vector;
    int column;
};

static void print(void *ctx, const char *vector, uint32_t word)
{
    struct place *at = ctx;
    if (strcmp(at->vector, vector) != 0) {
        printf("%s    /* %s */\n", at->column != 0 ? "\n" : "", vector);
        *at = (struct place){vector, 0};
    }
    printf("%s0x%08lX,%s", at->column == 0 ? "    " : " ", (unsigned long)word, at->column == 7 ? "\n" : "");
    at->column = (at->column + 1) % 8;
}

int main(void)
{
    struct place at = {"", 0};
    printf("/* SPDX-License-Identifier: Apache-2.0 */\n"
           "/* Words of golden_run() in the back end %s. Made by write.c: see README.md. */\n"
           "#include <stdint.h>\n\nstatic const uint32_t golden_words[] = {\n",
           NUM_NAME);
    golden_run(print, &at);
    printf("%s};\n", at.column != 0 ? "\n" : "");
    return 0;
}
