/* SPDX-License-Identifier: Apache-2.0 */
#include "start.h"

extern uint32_t data_begin[], data_end[], data_source[], bss_begin[], bss_end[];

void on_reset(void)
{
    uint32_t *from = data_source;
    for (uint32_t *to = data_begin; to < data_end; to++) *to = *from++;
    for (uint32_t *to = bss_begin; to < bss_end; to++) *to = 0;
    main();
}

void on_fault(void)
{
    for (;;) {}
}
