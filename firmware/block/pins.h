/* SPDX-License-Identifier: Apache-2.0
 *
 * How the ATmega328P of a block is wired; SPI (PB3, PB4, PB5) and I2C (PC4, PC5) are where they are.
 */
#ifndef EOL_PINS_H
#define EOL_PINS_H

enum {
    RADIO_CE = 1,   /* port B */
    RADIO_CSN = 2,
    BATTERY = 0,    /* port C: a quarter of the battery's voltage */
    WHITE_SENSE = 1,    /* a quarter of what the white LED leaves of it: none when it is lit, or broken */
    INFRARED_SENSE = 2, /* a quarter of what lies over the infrared LED */
    SENSOR_INT = 2, /* port D: high while the accelerometer has something */
    RADIO_IRQ = 3,  /* low while the radio has something */
    INFRARED = 5,
    WHITE = 6       /* OC0A */
};

#endif
