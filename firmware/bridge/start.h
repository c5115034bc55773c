/* SPDX-License-Identifier: Apache-2.0
 *
 * What every Cortex-M3 does before main.
 */
#ifndef EOL_START_H
#define EOL_START_H

#include <stdint.h>

typedef void (*handler)(void);

extern uint32_t stack_end[];

void on_reset(void);
void on_fault(void); /* waits until the watchdog bites */
int main(void);

#endif
