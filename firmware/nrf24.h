/* SPDX-License-Identifier: Apache-2.0
 *
 * The radio nRF24L01+ (Nordic, product specification 1.0) on SPI, 1 Mbit/s, in a block and on the
 * bridge. A block hears what the bridge says to all, and sends to the bridge, which acknowledges;
 * what the bridge sends nobody acknowledges.
 *
 * It never sends again by itself, for a knock's age would then be wrong. Lines on which nothing
 * answers, whether they stay high or low, are silence: no function waits for the chip.
 */
#ifndef EOL_NRF24_H
#define EOL_NRF24_H

#include <stdint.h>

enum { NRF24_NOTHING, NRF24_HEARD, NRF24_SENT, NRF24_LOST };
enum { NRF24_BLOCK, NRF24_BRIDGE };

/* Set it up to listen as a block or as the bridge; 0 when nothing answers. */
uint8_t nrf24_begin(uint8_t role);

/* Whether it is there and set up: 0 also after its supply has failed. */
uint8_t nrf24_answers(void);

/* Send EOL_FRAME bytes; `nrf24_look` says what came of it, and until then it is deaf. */
void nrf24_send(const uint8_t *frame);

/* What its pin was pulled for: NRF24_HEARD writes a frame. Call it until it says NRF24_NOTHING. */
uint8_t nrf24_look(uint8_t *frame);

/* Listen, whatever it did; frames that wait to be read are dropped. */
void nrf24_listen(void);

void nrf24_sleep(void);

/* What the board gives it: SPI in mode 0, 8 MHz at most, and the pins CSN and CE. */
uint8_t nrf24_port_exchange(uint8_t byte);
void nrf24_port_select(uint8_t selected); /* 1: CSN low */
void nrf24_port_enable(uint8_t enabled);  /* 1: CE high */
void nrf24_port_pulse(void);              /* wait for 10 us or some more */
void nrf24_port_settle(void);             /* for 2 ms, while its crystal starts */

#endif
