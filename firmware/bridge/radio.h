/* SPDX-License-Identifier: Apache-2.0
 *
 * The bridge's own nRF24L01+ (../nrf24.h): words out, frames of the blocks in. Where it does not
 * answer, or never gets a frame away, the host is told, and it is set up again until it does.
 */
#ifndef EOL_BRIDGE_RADIO_H
#define EOL_BRIDGE_RADIO_H

#include "bridge.h"

typedef struct {
    uint8_t answers, sending, ready; /* ready: `frame` is to be sent */
    uint8_t frame[EOL_FRAME];
    uint64_t sent_us, heard_us, looked_us;
} eol_radio;

void eol_radio_begin(eol_radio *radio, uint64_t now_us);

/* To be called again and again, and at once when its pin is pulled. */
void eol_radio_turn(eol_radio *radio, eol_bridge *bridge, uint64_t now_us);

#endif
