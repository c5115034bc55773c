/* SPDX-License-Identifier: Apache-2.0 */
#include "radio.h"

#include "../nrf24.h"

enum {
    SENT_WITHIN_US = 3000, /* takes 0.4 ms */
    ANSWERED_US = 250,     /* after a frame its acknowledgement goes out, which sending would cut off */
    LOOKS_US = 100000,     /* from one look at its registers to the next */
    AT_ONCE = 6            /* frames in a turn; it keeps three */
};

void eol_radio_begin(eol_radio *r, uint64_t now_us)
{
    r->sending = r->ready = 0;
    r->looked_us = now_us;
    r->answers = nrf24_begin(NRF24_BRIDGE);
}

static void look(eol_radio *r, eol_bridge *bridge, uint64_t now_us)
{
    uint8_t frame[EOL_FRAME], what;
    for (uint8_t k = 0; k < AT_ONCE && (what = nrf24_look(frame)) != NRF24_NOTHING; k++) {
        if (what == NRF24_HEARD) {
            r->heard_us = now_us;
            eol_bridge_heard(bridge, now_us, frame);
        } else if (r->sending) {
            r->sending = 0;
            eol_bridge_radio(bridge, 1);
        }
    }
}

static int fails(eol_radio *r, uint64_t now_us)
{
    if (r->sending && now_us - r->sent_us > SENT_WITHIN_US) return 1;
    if (now_us - r->looked_us < LOOKS_US) return 0;
    r->looked_us = now_us;
    return !nrf24_answers();
}

void eol_radio_turn(eol_radio *r, eol_bridge *bridge, uint64_t now_us)
{
    uint8_t frame[EOL_FRAME];
    if (!r->answers) {
        eol_bridge_radio(bridge, 0);
        if (now_us - r->looked_us >= LOOKS_US) eol_radio_begin(r, now_us);
        eol_bridge_says(bridge, now_us, frame); /* so that it misses its blocks */
        return;
    }
    if (!r->sending && !r->ready) r->ready = eol_bridge_says(bridge, now_us, r->frame); /* takes a while */
    look(r, bridge, now_us);
    if (fails(r, now_us)) {
        r->answers = 0;
    } else if (!r->sending && r->ready && now_us - r->heard_us >= ANSWERED_US) {
        nrf24_send(r->frame);
        r->ready = 0;
        r->sending = 1;
        r->sent_us = now_us;
    }
}
