/* SPDX-License-Identifier: Apache-2.0 */
#include "block.h"

#include <string.h>

enum { FLAG_WOKE = 1, FLAG_LINKED = 1, FLAG_DEAD = 2, FLAG_ASLEEP = 4, NOT_LIT = 0xFFFF };

void eol_block_begin(eol_block *b, uint8_t number)
{
    memset(b, 0, sizeof *b);
    b->number = number;
    b->groups = 1;
    if (number < EOL_BLOCK_NUMBERS) {
        b->group = number / EOL_GROUP;
        b->own = (uint32_t)1 << number % EOL_GROUP;
    }
    b->infrared = 1;
    b->by_itself = 1;
    b->peak = 255;
    b->decay_ms = 100;
    b->silent_ms = EOL_BLOCK_ALONE_MS;
    b->due = 1;
    b->test_ms = EOL_BLOCK_TEST_MS;
    eol_knock_begin(&b->knock, &EOL_KNOCK_DEFAULTS);
    eol_light_begin(&b->light, b->by_itself, b->peak, b->decay_ms, b->each, b->groups);
}

static void tell(eol_block *b, uint8_t only_lit)
{
    b->tries = EOL_BLOCK_TRIES;
    b->pause_ms = 0;
    b->knocks++;
    b->untold = 0;
    b->only_lit = only_lit;
}

/* An order that comes now is the last one, told again. */
static void obeyed(eol_block *b)
{
    b->order_ms = (uint8_t)(EOL_BLOCK_ORDER_MS * eol_link_orders(b->groups));
}

uint8_t eol_block_sample(eol_block *b, uint32_t now_us, int16_t x, int16_t y)
{
    uint8_t what = eol_knock_sample(&b->knock, x, y);
    if (what == EOL_KNOCK_FELT) {
        b->flags = eol_light_felt(&b->light);
        b->lit_us = now_us;
        if (b->flags) {
            b->uncounted = b->untold = 1;
            obeyed(b); /* a missed order that is told again would be a flash that nobody counts */
        }
    } else if (what == EOL_KNOCK_TOLD) {
        uint32_t lit_us, age_us = ((uint32_t)b->knock.age * EOL_BLOCK_PERIOD_US) >> 4;
        if (b->knock.first) age_us += EOL_BLOCK_WAKE_LATE_US;
        b->onset_us = now_us - age_us;
        b->strength = (uint16_t)((uint32_t)b->knock.strength * 4017u >> 16); /* 0.01 m/s^2 */
        lit_us = b->flags ? b->lit_us - b->onset_us : NOT_LIT;
        b->lit_us = lit_us < NOT_LIT ? lit_us : b->flags ? NOT_LIT - 1u : NOT_LIT;
        tell(b, 0);
    }
    if (b->knock.dead != b->was_dead) {
        b->was_dead = b->knock.dead;
        b->due = 1;
    }
    return what;
}

void eol_block_sensor(eol_block *b, uint8_t answers)
{
    if (b->absent == !answers) return;
    b->absent = !answers;
    b->due = 1;
    if (answers) eol_knock_wake(&b->knock);
}

void eol_block_shines(eol_block *b, uint32_t now_us)
{
    b->lit_us = now_us;
}

/* How blocks flash has changed; what shines goes on to shine. */
static void relight(eol_block *b)
{
    uint32_t level = b->light.level;
    eol_light_begin(&b->light, b->by_itself, b->peak, b->decay_ms, b->each, b->groups);
    b->light.level = level;
}

/* Take a word for the group of blocks; what is true of all blocks, of any group. */
static void take_word(eol_block *b, const uint8_t *frame, uint8_t group)
{
    uint8_t by_itself = frame[1] & EOL_WORD_BY_ITSELF ? 1 : 0, peak = frame[2], count = frame[13];
    uint8_t each = frame[1] & EOL_WORD_EACH ? 1 : 0, falls = (frame[1] & EOL_WORD_FALLS) != 0;
    uint16_t decay_ms = eol_link_get16(frame + 3);
    uint32_t infrared = eol_link_get32(frame + 5), light = eol_link_get32(frame + 9);
    uint8_t groups = (uint8_t)((frame[8] >> (EOL_WORD_GROUPS_BIT - 24)) + 1);
    if (groups > EOL_GROUPS) groups = EOL_GROUPS;
    if (each) {
        uint32_t falling = eol_link_get16(frame + 15) | (uint32_t)frame[17] << 16;
        if (frame[1] & EOL_WORD_LAST) falling |= (uint32_t)1 << (EOL_GROUP - 1);
        falls = (falling & b->own) && !b->uncounted && !b->settle_ms;
    }
    if (by_itself != b->by_itself || peak != b->peak || decay_ms != b->decay_ms || each != b->each || groups != b->groups) {
        b->groups = groups;
        b->each = each;
        b->by_itself = by_itself;
        b->peak = peak;
        b->decay_ms = decay_ms;
        relight(b);
    }
    b->silent_ms = 0;
    if (b->own && frame[14] == b->number + 1 && !b->test_tries && b->test_ms >= EOL_BLOCK_TEST_MS) b->testing = 1;
    if (group == b->group || !each) eol_light_told(&b->light, falls);
    if (group != b->group) return;
    b->infrared = b->own ? (infrared & b->own) != 0 : 1;
    /* the order is in every word until the next one; to a block that has just come it is old */
    if (b->words && count != b->light_count && (light & b->own) && !b->order_ms) {
        obeyed(b);
        eol_light_flash(&b->light, (uint8_t)(EOL_WHOLE - (light >> EOL_WORD_DIM_BIT)));
        if (each) eol_light_told(&b->light, falls); /* this word knows of the flash */
    }
    b->light_count = count;
    b->words = 1;
}

static void take_detector(eol_knock_config *to, const uint8_t *body)
{
    uint16_t *fields[] = {&to->threshold, &to->ratio, &to->quiet, &to->slow, &to->still, &to->longest};
    for (uint8_t k = 0; k < 6; k++) {
        uint16_t value = eol_link_get16(body + 2 * k);
        if (value) *fields[k] = value;
    }
    if (eol_link_get32(body + 12)) to->idle = eol_link_get32(body + 12);
}

void eol_block_heard(eol_block *b, const uint8_t *frame)
{
    uint8_t group = (uint8_t)(frame[0] - EOL_FRAME_WORD);
    if (group < EOL_GROUPS) take_word(b, frame, group);
    if (frame[0] == EOL_FRAME_FEELS) take_detector(&b->knock.config, frame + 1);
}

uint8_t eol_block_says(eol_block *b, uint32_t now_us, uint8_t *frame)
{
    if (b->number >= EOL_BLOCK_NUMBERS || b->pause_ms) return 0;
    if (b->untold && !b->tries && b->knock.state != EOL_KNOCK_FEELS) tell(b, 1);
    if (b->tries) {
        uint32_t age_us = now_us - b->onset_us;
        memset(frame, 0, EOL_FRAME);
        frame[0] = b->only_lit ? EOL_FRAME_LIT : EOL_FRAME_KNOCK;
        frame[1] = b->number;
        frame[9] = b->knocks;
        if (b->only_lit) return 1;
        frame[2] = b->knock.first ? FLAG_WOKE : 0;
        eol_link_put16(frame + 3, (uint16_t)(age_us > UINT16_MAX ? UINT16_MAX : age_us));
        eol_link_put16(frame + 5, b->strength);
        eol_link_put16(frame + 7, (uint16_t)b->lit_us);
        return 1;
    }
    memset(frame, 0, EOL_FRAME);
    if (b->test_tries) {
        frame[0] = EOL_FRAME_TESTED;
        frame[1] = b->number;
        frame[2] = b->test.answers;
        for (uint8_t k = 0; k < 3; k++) eol_link_put16(frame + 3 + 2 * k, (uint16_t)b->test.change_mg[k]);
        eol_link_put16(frame + 9, b->test.white_off_mv);
        eol_link_put16(frame + 11, b->test.white_on_mv);
        eol_link_put16(frame + 13, b->test.infrared_mv);
        return 1;
    }
    if (!b->due) return 0;
    frame[0] = EOL_FRAME_STATUS;
    frame[1] = b->number;
    eol_link_put16(frame + 2, b->millivolts);
    frame[4] = (uint8_t)b->celsius;
    frame[5] = EOL_BLOCK_MAJOR;
    frame[6] = EOL_BLOCK_MINOR;
    frame[7] = (uint8_t)(FLAG_LINKED | (b->knock.dead || b->absent ? FLAG_DEAD : 0) | (b->asleep ? FLAG_ASLEEP : 0));
    return 1;
}

void eol_block_told(eol_block *b, uint8_t heard)
{
    if (b->tries) {
        b->tries = heard ? 0 : (uint8_t)(b->tries - 1);
        if (heard && !b->untold) {
            b->uncounted = 0;
            b->settle_ms = EOL_BLOCK_SETTLE_MS;
        }
    } else if (b->test_tries) {
        b->test_tries = heard ? 0 : (uint8_t)(b->test_tries - 1);
    } else {
        b->due = 0; /* the next one comes anyway */
        if (heard && b->uncounted) b->untold = 1; /* it was told in vain */
        b->status_ms = !heard; /* a word every 2 ms made the bridge deaf: the next one comes between them */
    }
    /* two blocks that spoke at once must not do so again: each waits its own way */
    if (!heard) b->pause_ms = (uint8_t)(1 + (b->number * 5 + b->tries * 3 + (uint8_t)b->lit_us) % 4);
}

void eol_block_tested(eol_block *b, const eol_test *test)
{
    b->test = *test;
    b->testing = 0;
    b->test_ms = 0;
    b->test_tries = EOL_BLOCK_TRIES;
    b->pause_ms = 0;
    eol_knock_wake(&b->knock); /* what the sensor has felt since was its own */
}

uint8_t eol_block_level(const eol_block *b)
{
    return (uint8_t)((b->light.level + 0x8000) >> 16);
}

void eol_block_tick(eol_block *b)
{
    eol_light_tick(&b->light);
    if (b->pause_ms) b->pause_ms--;
    if (b->settle_ms) b->settle_ms--;
    if (b->order_ms) b->order_ms--;
    if (b->test_ms < EOL_BLOCK_TEST_MS) b->test_ms++;
    if (b->silent_ms < EOL_BLOCK_ALONE_MS) b->silent_ms++;
    if (++b->status_ms >= (uint16_t)(EOL_BLOCK_STATUS_MS * b->groups)) {
        b->status_ms = 0;
        b->due = 1;
    }
}

uint8_t eol_block_may_sleep(const eol_block *b)
{
    return b->knock.state == EOL_KNOCK_RESTS && b->knock.rested >= b->knock.config.idle && !b->light.level &&
           !b->tries && !b->due && !b->testing && !b->test_tries;
}

void eol_block_sleeps(eol_block *b, uint8_t sleeps)
{
    b->asleep = sleeps;
    b->due = 1;
    if (!sleeps) eol_knock_wake(&b->knock);
}
