/* SPDX-License-Identifier: Apache-2.0
 *
 * The bridge, whatever it is built of: bytes of the host and frames of the blocks in, bytes and
 * frames out (docs/reference/serial.md). bluepill.c gives it a processor.
 *
 *     for (;;) {
 *         now_us = ...;                                       64 bits, never backwards
 *         eol_bridge_byte(&bridge, now_us, byte);             for each that came from the host
 *         eol_bridge_heard(&bridge, now_us, frame);           for each that came by radio
 *         if (eol_bridge_says(&bridge, now_us, frame)) ...    send it by radio
 *         while (eol_bridge_sends(&bridge, &byte)) ...        send it to the host
 *     }
 */
#ifndef EOL_BRIDGE_H
#define EOL_BRIDGE_H

#include <stdint.h>

#include "../eol_serial.h"
#include "../link.h"
#include "local.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EOL_BRIDGE_MAJOR = 2,
    EOL_BRIDGE_MINOR = 6,
    EOL_BRIDGE_ROOM = 1024,           /* bytes that wait for the host; a power of two */
    EOL_BRIDGE_SILENT_MS = 3000,      /* a block that was heard and now is not; for each group */
    EOL_BRIDGE_ORDER_MS = 20,         /* an order is told again with one that follows so soon; eol_link_orders times that */
    EOL_BRIDGE_DETECTOR_US = 1000000, /* from one telling of the detector's numbers to the next */
    EOL_BRIDGE_SAID_MS = 10000,       /* a status is told again after that, changed or not */
    EOL_BRIDGE_COUNT_MS = 10000,      /* statuses are counted for so long; for each group */
    EOL_BRIDGE_ONE_SAYS = 13,         /* a block says ten meanwhile, and a few more where it changes; two say 20 */
    EOL_BRIDGE_TEST_US = 10000000     /* so long a block is asked to test itself: one that sleeps looks every 4 s */
};

/* Times in ms wrap; they are looked at long before that. */
typedef struct {
    uint32_t heard_ms, said_ms, count_ms;
    uint16_t ordered_ms;
    uint8_t body[7];     /* of its last status */
    uint8_t knocks;      /* number of its last knock */
    uint8_t says;        /* statuses since count_ms */
    uint8_t heard : 1;   /* ever */
    uint8_t linked : 1;
    uint8_t knocked : 1; /* there was a knock */
    uint8_t twice : 1;   /* more than one block has this number */
} eol_bridge_block;

/* What is in the words of a group. */
typedef struct {
    uint32_t infrared, order; /* masks */
    uint32_t due;             /* of the order: what is not counted, for no word has said it */
    uint32_t order_ms;
    uint8_t orders;
    uint8_t share;            /* of the peak, in 1 / EOL_WHOLE, that the order sets */
} eol_bridge_group;

typedef struct {
    eol_decoder line;
    union {
        eol_flash_field field;
        eol_local_field local;
    } light;                      /* which, `flags` says */
    eol_bridge_block blocks[EOL_BLOCKS];
    eol_bridge_group groups[EOL_GROUPS];
    uint8_t columns, most, places; /* of Lattice */
    uint8_t group;                /* of the last word */
    uint8_t reported;             /* blocks whose status is told since the last Lighting */
    uint8_t flags, peak, decided; /* of Lighting; `decided`: light may fall, as it was said last */
    uint16_t decay_ms;
    uint8_t detector[16], feels;  /* as the host has set it; 1: it has */
    uint8_t mute;                 /* 1: its radio does not work */
    uint8_t test;                 /* number of the block that is to test itself, plus 1; 0: none */
    uint64_t word_us, feels_us, test_us;
    uint8_t sequence;
    uint16_t begin, count;        /* of the ring */
    uint8_t ring[EOL_BRIDGE_ROOM];
    uint32_t dropped;             /* packets for which there was no room */
} eol_bridge;

void eol_bridge_begin(eol_bridge *bridge, uint64_t now_us);

/* Take a byte of the host. */
void eol_bridge_byte(eol_bridge *bridge, uint64_t now_us, uint8_t byte);

/* Take EOL_FRAME bytes of the radio; whatever they are. */
void eol_bridge_heard(eol_bridge *bridge, uint64_t now_us, const uint8_t *frame);

/* Its radio works, or does not; the host is told where that changes. */
void eol_bridge_radio(eol_bridge *bridge, uint8_t works);

/* Write a frame that is to be sent now, and return 1. */
uint8_t eol_bridge_says(eol_bridge *bridge, uint64_t now_us, uint8_t *frame);

/* Take the next byte for the host; returns 0 where there is none. */
uint8_t eol_bridge_sends(eol_bridge *bridge, uint8_t *byte);

#ifdef __cplusplus
}
#endif
#endif
