/* SPDX-License-Identifier: Apache-2.0
 *
 * The white LED of one block: lit by its own knock at once, and by the bridge; then it dies away.
 *
 * How fast is not for the block to say, for it does not know what the others do, and the field must
 * not flash more than three times a second (firmware/bridge/flash.h). So light dies away slowly, by
 * 8 % in a third of a second (tau 4 s), unless the bridge has said within the last 0.011 of the decay
 * time that light may fall. What such a block does alone or beside others like it is no flash. The
 * link is given as much again: together that is 0.022 of the decay time, 2.2 %, within which a block
 * that falls has stopped falling when another one flashes; with the 8 % until the next fall that
 * is less than the 10 % that count.
 *
 * With `each` the bridge says so of this block alone (firmware/bridge/local.h), and nothing but its
 * own flash ends a fall: no lease and no link can be late. It holds by 6 % in 1.07 s (tau 17 s), and
 * may obey a word for 20 ms for each group of blocks, in which nine of ten may be lost.
 */
#ifndef EOL_LIGHT_H
#define EOL_LIGHT_H

#include <stdint.h>

#include "../link.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EOL_LIGHT_SHORTEST_MS = 182, /* a shorter decay is taken as this: 2 ms for the link */
    EOL_LIGHT_SHORTEST_EACH_MS = 20,
    EOL_LIGHT_HOLD_MS = 4003,
    EOL_LIGHT_HOLD_EACH_MS = 17293
};

typedef struct {
    uint32_t level; /* 255 is 255 << 16 */
    uint32_t fall;  /* share that is lost in a millisecond of falling, 1 / 2^32 */
    uint8_t peak;
    uint8_t by_itself; /* 1: a knock lights it */
    uint8_t each;      /* 1: blocks are limited one by one */
    uint8_t lease_ms;  /* for how long the bridge's word holds */
    uint8_t left_ms;
} eol_light;

/* Begin in the dark, one of a table of so many groups. */
void eol_light_begin(eol_light *light, uint8_t by_itself, uint8_t peak, uint16_t decay_ms, uint8_t each,
                     uint8_t groups);

/* The detector felt a knock. Returns 1 when that lit the block. */
uint8_t eol_light_felt(eol_light *light);

/* The bridge says: light up, to `share` / EOL_WHOLE of the peak. */
void eol_light_flash(eol_light *light, uint8_t share);

/* The bridge says whether light may fall. */
void eol_light_told(eol_light *light, uint8_t falls);

/* A millisecond has passed; returns the level 0..255. */
uint8_t eol_light_tick(eol_light *light);

#ifdef __cplusplus
}
#endif
#endif
