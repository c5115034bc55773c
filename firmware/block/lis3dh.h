/* SPDX-License-Identifier: Apache-2.0
 *
 * The accelerometer LIS3DH (ST, DocID17530 rev 2) on I2C: 1344 samples a second at +-2 g, kept in
 * its own memory for 32, so that the controller may be late.
 */
#ifndef EOL_LIS3DH_H
#define EOL_LIS3DH_H

#include <stdint.h>

/* Set it up to write samples; 0 when nothing answers. */
uint8_t lis3dh_begin(void);

/* Read the oldest sample, 1/16 mg; 0 when the bus fails. */
uint8_t lis3dh_read(int16_t *x, int16_t *y);

/* Let it pull its own mass and write by how much x, y and z change, mg; 0 when nothing answers. Takes
 * 70 ms, after which it is to be set up again; `feed` is called meanwhile. */
uint8_t lis3dh_test(int16_t change_mg[3], void (*feed)(void));

/* Look 100 times a second, coarsely, and raise its pin at 32 mg. */
uint8_t lis3dh_sleep(void);

#endif
