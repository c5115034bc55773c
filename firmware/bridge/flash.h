/* SPDX-License-Identifier: Apache-2.0
 *
 * The light of all blocks and its limit of three flashes a second: eol_ros/core/light/flash.py
 * in C99, which says what the limit is and why it holds.
 *
 * It lives in the bridge. A block flashes by itself and cannot know what the others do; the host
 * knows, but milliseconds later, and not while the line is broken. The bridge hears all blocks and
 * the host, so it alone can count them together: each flash that a block reports and each that the
 * host commands is an eol_flash_slip, and a linked block is told to hold while
 * eol_flash_holds. Double precision is soft on a Cortex-M3: one exp and one log for an image.
 */
#ifndef EOL_FLASH_H
#define EOL_FLASH_H

#include <stdint.h>

#include "../link.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { EOL_FLASH_BLOCKS = EOL_GROUP * EOL_GROUPS }; /* at most */

typedef struct {
    double decay_s, peak;
    double now_s;
    double fall_at_s; /* when the present fall began, or the next one may */
    double fell_s;    /* when light was last seen falling */
    double level[EOL_FLASH_BLOCKS];
    uint32_t lengthened; /* falls that had to wait */
    uint8_t limited, count; /* of blocks */
} eol_flash_field;

/* Begin with `count` blocks in the dark. `decay_s` > 0: time constant of a fall; `peak` 0..1: what a slip sets. */
void eol_flash_begin(eol_flash_field *field, double decay_s, double peak, uint8_t limited, uint8_t count);

/* Light `block` at `now_s` to a share of the peak; nothing falls until the limit allows it again. */
void eol_flash_slip(eol_flash_field *field, double now_s, uint8_t block, double share);

/* Write the level 0..255 of each block at `now_s`. */
void eol_flash_levels(eol_flash_field *field, double now_s, uint8_t *levels);

/* Let nothing fall before `until_s`, whatever the limit says. */
void eol_flash_hold(eol_flash_field *field, double now_s, double until_s);

/* 1 while light must not fall: the blocks decay by the hold rate, not by their own. */
uint8_t eol_flash_holds(const eol_flash_field *field, double now_s);

/* What of its light a block keeps over `span_s`, at the rate of a hold or of a fall. */
double eol_flash_share(const eol_flash_field *field, double span_s, uint8_t holds);

#ifdef __cplusplus
}
#endif
#endif
