/* SPDX-License-Identifier: Apache-2.0
 *
 * The light of all blocks and its limit within each 10 degree field of view:
 * eol_ros/core/light/local.py in C99, which says what the limit is and why it holds.
 *
 * It lives in the bridge, as flash.h does; each block has its own bit of what may fall. A flash takes
 * one exp and one log: levels are kept as logarithms.
 */
#ifndef EOL_LOCAL_H
#define EOL_LOCAL_H

#include "flash.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EOL_LOCAL_COLUMNS = 5, /* of the default table */
    EOL_LOCAL_BLOCKS = 25, /* the same */
    EOL_LOCAL_FALLS = 3    /* of a block in any second, at most */
};

typedef struct {
    double height, at_s;            /* ln of the level over that which counts as dark, at that time */
    double fall_s;                  /* when its fall began, or the next one may */
    double free_s[EOL_LOCAL_FALLS]; /* a period after the ends of its last falls, rising */
} eol_local_block;

typedef struct {
    double decay_s, peak, now_s, period_s;
    double first; /* height of a slip after rest */
    eol_local_block block[EOL_FLASH_BLOCKS];
    uint32_t lengthened;        /* falls that had to wait */
    uint32_t falls[EOL_GROUPS]; /* which may fall, until next_s: a word must not take long */
    double next_s;
    uint8_t columns, most, count; /* of the table; falls of a block in any second; places */
} eol_local_field;

/* Begin in the dark, with the default table. */
void eol_local_begin(eol_local_field *field, double decay_s, double peak);

/* Take another table, in the dark: at least 2 columns, 1 to EOL_LOCAL_FALLS falls of a block. */
void eol_local_shape(eol_local_field *field, uint8_t columns, uint8_t most, uint8_t count);

/* How long after a fall the next one counts for itself, s: a second, 50 ms, and 20 ms for each group of blocks. */
double eol_local_period(uint8_t count);

/* Change how blocks flash from `now_s` on. */
void eol_local_set(eol_local_field *field, double now_s, double decay_s, double peak);

/* Light `block` at `now_s` to a share of the peak. */
void eol_local_slip(eol_local_field *field, double now_s, uint8_t block, double share);

/* 1: an order to a share of the peak finds `block` held, or raises it as far as a slip has to. */
uint8_t eol_local_takes(eol_local_field *field, double now_s, uint8_t block, double log_share);

/* Let `block` not fall before `until_s`, nor within a period. */
void eol_local_hold(eol_local_field *field, double now_s, double until_s, uint8_t block);

/* Nothing is known of `block` any more: it may shine, and it holds. */
void eol_local_unknown(eol_local_field *field, double now_s, uint8_t block);

/* Begin with nothing known of any block. */
void eol_local_unknown_all(eol_local_field *field, double now_s);

/* Write the level 0..255 of each block at `now_s`. */
void eol_local_levels(eol_local_field *field, double now_s, uint8_t *levels);

/* Bit b: the light of block b of the group may fall. */
uint32_t eol_local_falls(eol_local_field *field, double now_s, uint8_t group);

#ifdef __cplusplus
}
#endif
#endif
