/* SPDX-License-Identifier: Apache-2.0
 *
 * An nRF24L01+ as its product specification 1.0 has it, for emulated blocks and for the emulated
 * bridge. Times are in ns since the start. What no chip would do, or what it would not understand,
 * is counted in `strange`.
 *
 *     radio_csn, radio_ce, radio_byte    what the firmware does with the pins and on SPI
 *     radio_advance                      let time pass; a packet whose end is due is in `sent`
 *     radio_hears                        a packet of somebody else has ended
 */
#ifndef EOL_EMULATED_RADIO_H
#define EOL_EMULATED_RADIO_H

#include <stdint.h>

enum { RADIO_FIFO = 3, RADIO_BYTES = 32 };
enum { RADIO_RESTS, RADIO_SENDS, RADIO_WAITS, RADIO_ANSWERS };     /* `phase` */
enum { RADIO_LOW = 1, RADIO_HIGH, RADIO_NO_CE, RADIO_NO_IRQ };      /* `fault`: MISO stays low or high, a wire is open */

typedef struct {
    uint64_t begin_ns, end_ns;
    uint8_t address[5], channel, setup, size, number, unanswered; /* setup: rate and checksum */
    uint8_t bytes[RADIO_BYTES];
} radio_packet;

typedef struct {
    uint8_t reg[32][5], fault;
    uint8_t csn, ce, command, at; /* pins; of the command on SPI: what, which byte */
    radio_packet tx[RADIO_FIFO], rx[RADIO_FIFO];
    uint8_t rx_pipe[RADIO_FIFO], tx_count, rx_count, number;
    radio_packet last; /* heard */
    uint8_t heard;     /* 1: there is one */
    int phase;
    uint64_t phase_ends_ns, ready_ns, raised_ns, listens_ns; /* powered up; CE went up; it listens from then on */
    radio_packet sent; /* the one in the air, or the last */
    uint8_t was_sent;  /* 1: it has ended since that was last looked at */
    uint8_t answered;  /* 1: the acknowledgement of the last packet heard has gone out */
    uint64_t answer_ns;
    uint64_t strange, full; /* packets that found no room */
} radio;

void radio_begin(radio *r);

/* Its supply fails for a moment: all registers are those of a new chip. */
void radio_reset(radio *r);

void radio_csn(radio *r, uint8_t high);
void radio_ce(radio *r, uint8_t high, uint64_t now_ns);
uint8_t radio_byte(radio *r, uint8_t in, uint64_t now_ns);
void radio_advance(radio *r, uint64_t now_ns);

/* 1: it has listened since `since_ns` without a break, and listens now. */
int radio_listens(const radio *r, uint64_t since_ns);

/* A packet has ended; 1 when the chip has taken it. `radio_asks` tells whether it then acknowledges. */
int radio_hears(radio *r, const radio_packet *packet);
int radio_asks(const radio *r, const radio_packet *packet);

/* The acknowledgement of what it has sent is there. */
void radio_acknowledged(radio *r, uint64_t now_ns);

/* The level of IRQ, which has a pull-up. */
int radio_irq(const radio *r);

#endif
