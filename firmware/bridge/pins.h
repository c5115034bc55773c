/* SPDX-License-Identifier: Apache-2.0
 *
 * How the bridge is wired: pins of a "Blue Pill" board (STM32F103C8T6), the radio's six in one row.
 */
#ifndef EOL_BRIDGE_PINS_H
#define EOL_BRIDGE_PINS_H

enum {
    RADIO_CSN = 4,  /* port A */
    SCK = 5,
    MISO = 6,       /* pulled up: where no radio is, it says ones */
    MOSI = 7,
    TO_HOST = 9,
    FROM_HOST = 10,
    RADIO_CE = 0,   /* port B */
    RADIO_IRQ = 1,  /* low while the radio has something; pulled up */
    LIT = 13        /* port C: the board's own LED, lit by a low pin while the radio works */
};

#endif
