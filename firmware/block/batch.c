/* SPDX-License-Identifier: Apache-2.0
 *
 * Many samples, or many blocks, in one call, for the twin and the tests; a block takes them one by one.
 */
#include <stddef.h>

#include "block.h"

typedef struct {
    uint32_t sample; /* which of the samples given brought it */
    uint16_t strength, age;
    uint8_t what, first;
} eol_knock_event;

size_t eol_knock_size(void)
{
    return sizeof(eol_knock);
}

/* Take `count` pairs of x, y; write what they bring, `room` events at most; return how many. */
size_t eol_knock_batch(eol_knock *knock, const int16_t *xy, size_t count, eol_knock_event *events,
                       size_t room)
{
    size_t found = 0;
    for (size_t n = 0; n < count; n++) {
        uint8_t what = eol_knock_sample(knock, xy[2 * n], xy[2 * n + 1]);
        if (what != EOL_KNOCK_NONE && found < room) {
            eol_knock_event event = {(uint32_t)n, knock->strength, knock->age, what, knock->first};
            events[found++] = event;
        }
    }
    return found;
}

/* ---- the blocks of a table, which have the numbers 0 to `count` - 1 */

enum { SHINES_US = 410 }; /* after the end of a sample: `make firmware` */

/* They have no parts that could be broken: what a whole block of docs/build would measure. */
static const eol_test WHOLE = {1, {400, 400, 400}, 1500, 100, 1350};

size_t eol_block_size(void)
{
    return sizeof(eol_block);
}

void eol_blocks_begin(eol_block *blocks, size_t count)
{
    for (size_t k = 0; k < count; k++) eol_block_begin(&blocks[k], (uint8_t)k);
}

/* Give `count` samples to one block: the first ended at `first_us`, the others `period_us` apart. */
void eol_blocks_feel(eol_block *block, double first_us, double period_us, const int16_t *xy, size_t count,
                     uint8_t woken)
{
    if (woken) eol_knock_wake(&block->knock);
    for (size_t n = 0; n < count; n++) {
        uint32_t now_us = (uint32_t)(uint64_t)(first_us + (double)n * period_us);
        if (eol_block_sample(block, now_us, xy[2 * n], xy[2 * n + 1]) == EOL_KNOCK_FELT)
            eol_block_shines(block, now_us + SHINES_US);
    }
}

/* All hear a frame but those that are deaf, a byte each. */
void eol_blocks_heard(eol_block *blocks, size_t count, const uint8_t *frame, const uint8_t *deaf)
{
    for (size_t k = 0; k < count; k++)
        if (!deaf[k]) eol_block_heard(&blocks[k], frame);
}

/* `ms` milliseconds have passed for all; write their levels and what they say, EOL_FRAME bytes each.
 * `lost`, a byte each: the bridge does not hear that block. Returns how many frames it heard. */
size_t eol_blocks_tick(eol_block *blocks, size_t count, uint32_t ms, double now_us, const uint8_t *lost,
                       uint8_t *levels, uint8_t *frames)
{
    size_t said = 0;
    for (size_t k = 0; k < count; k++) {
        uint8_t *frame = frames + said * EOL_FRAME;
        for (uint32_t n = 0; n < ms; n++) eol_block_tick(&blocks[k]);
        if (blocks[k].testing) eol_block_tested(&blocks[k], &WHOLE);
        levels[k] = eol_block_level(&blocks[k]);
        if (!eol_block_says(&blocks[k], (uint32_t)(uint64_t)now_us, frame)) continue;
        eol_block_told(&blocks[k], !lost[k]);
        said += !lost[k];
    }
    return said;
}
