/* SPDX-License-Identifier: Apache-2.0
 *
 * The radio nRF24L01+ (Nordic, product specification 1.0) on SPI, 1 Mbit/s: hears what the bridge
 * says to all, and sends to the bridge, which acknowledges.
 *
 * It never sends again by itself, for a knock's age would then be wrong.
 */
#ifndef EOL_NRF24_H
#define EOL_NRF24_H

#include <stdint.h>

enum { NRF24_NOTHING, NRF24_HEARD, NRF24_SENT, NRF24_LOST };

/* Set it up to listen; 0 when nothing answers. */
uint8_t nrf24_begin(void);

/* Send EOL_FRAME bytes; `nrf24_look` says what came of it. */
void nrf24_send(const uint8_t *frame);

/* What its pin was pulled for: NRF24_HEARD writes a frame. Call it until it says NRF24_NOTHING. */
uint8_t nrf24_look(uint8_t *frame);

/* Listen again, whatever it did. */
void nrf24_listen(void);

void nrf24_sleep(void);

#endif
