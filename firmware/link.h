/* SPDX-License-Identifier: Apache-2.0
 *
 * What blocks and bridge say to each other by radio, docs/reference/serial.md: frames of one size, little-endian.
 * A word is for one group of blocks, group 0 the first 25; the bridge says the groups in turn.
 * The radio (nRF24L01+, nrf24.h) adds address and checksum, and lets nothing through that is damaged.
 */
#ifndef EOL_LINK_H
#define EOL_LINK_H

#include <stdint.h>

enum {
    EOL_FRAME = 18, /* bytes of every frame; those that a kind does not use are 0 */
    EOL_CHANNEL = 76, /* 2.476 GHz, above WLAN */
    EOL_WORD_MS = 2,  /* from word to word of the bridge */
    EOL_GROUP = 25,   /* blocks of a word */
    EOL_GROUPS = 9,
    EOL_WHOLE = 128,  /* shares of the peak in an order of the whole peak */
    EOL_AIR_US = 550  /* from when a knock's age is taken to the end of its frame: SPI, 130 us, air */
};

/* Where frames go: to the one bridge, to all blocks. */
#define EOL_TO_BRIDGE {0xE7, 0x4C, 0x6F, 0x45, 0xB1}
#define EOL_TO_BLOCKS {0xC2, 0x4C, 0x6F, 0x45, 0xB1}

enum { /* first byte of a frame */
    EOL_FRAME_WORD = 0x57,    /* and as many more as groups: bridge to all: flags, peak, decay_ms u16, infrared u32 with the
                               * number of groups, less 1, in its upper four bits, light u32 with what an order is dimmer
                               * than the peak, in 1 / EOL_WHOLE, in its upper seven, count, test, falls u24 */
    EOL_FRAME_FEELS = 0x46,   /* bridge to all: the body of EOL_DETECTOR */
    EOL_FRAME_KNOCK = 0x4B,   /* block: block, flags, age_us u16, strength u16, lit_us u16, number */
    EOL_FRAME_LIT = 0x4C,     /* block: it lit itself, as at a knock that is not told: block, 7 unused, number */
    EOL_FRAME_STATUS = 0x53,  /* block: the body of EOL_BLOCK_STATUS */
    EOL_FRAME_TESTED = 0x54   /* block: the body of EOL_SELF_TESTED */
};

/* Flags of a word. FALLS: the light of all may fall. EACH: those may of `falls`, and the 25th of the group with LAST. */
enum { EOL_WORD_BY_ITSELF = 1, EOL_WORD_FALLS = 4, EOL_WORD_EACH = 8, EOL_WORD_LAST = 16, EOL_WORD_GROUPS_BIT = 28, EOL_WORD_DIM_BIT = 25 };

/* How many groups `blocks` make. */
static inline uint8_t eol_link_groups(uint8_t blocks)
{
    return (uint8_t)((blocks + EOL_GROUP - 1) / EOL_GROUP);
}

/* How often an order is repeated, and for how long a block takes it for the same: the more, the rarer its words. */
static inline uint8_t eol_link_orders(uint8_t groups)
{
    return groups < 3 ? groups : 3;
}

static inline uint16_t eol_link_get16(const uint8_t *from)
{
    return (uint16_t)(from[0] | from[1] << 8);
}

static inline uint32_t eol_link_get32(const uint8_t *from)
{
    return eol_link_get16(from) | (uint32_t)eol_link_get16(from + 2) << 16;
}

static inline void eol_link_put16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)value;
    to[1] = (uint8_t)(value >> 8);
}

static inline void eol_link_put32(uint8_t *to, uint32_t value)
{
    eol_link_put16(to, (uint16_t)value);
    eol_link_put16(to + 2, (uint16_t)(value >> 16));
}

#endif
