/* SPDX-License-Identifier: Apache-2.0
 *
 * What a block does, whatever it is built of: samples and the bridge's frames in, light and frames
 * out. main.c gives it an ATmega328P; the tests and the twin's blocks run it on the host.
 *
 * Time is a microsecond counter that wraps.
 */
#ifndef EOL_BLOCK_H
#define EOL_BLOCK_H

#include <stdint.h>

#include "../link.h"
#include "knock.h"
#include "light.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EOL_BLOCK_MAJOR = 2,
    EOL_BLOCK_MINOR = 6,
    EOL_BLOCK_NUMBERS = EOL_GROUP * EOL_GROUPS,
    EOL_BLOCK_TRIES = 12,          /* of one knock, until somebody has heard it */
    EOL_BLOCK_STATUS_MS = 1000,    /* from status to status, for each group; the bridge misses a block after three */
    EOL_BLOCK_PERIOD_US = 744,     /* from sample to sample: 1344 Hz */
    EOL_BLOCK_WAKE_LATE_US = 5000, /* half of the time between two looks of a sensor that sleeps */
    EOL_BLOCK_ORDER_MS = 25,       /* an order that comes sooner is the last one, told again; eol_link_orders times that */
    EOL_BLOCK_SETTLE_MS = 4,       /* a word that comes later was written when the bridge knew the flash */
    EOL_BLOCK_ALONE_MS = 250,      /* without a word of the bridge */
    EOL_BLOCK_TEST_MS = 1000       /* from self-test to self-test: the order stays in the words for a while */
};

/* What a self-test has measured; the host judges. */
typedef struct {
    uint8_t answers;       /* 1: the accelerometer says what it is */
    int16_t change_mg[3];  /* of x, y, z while its own force pulls */
    uint16_t white_off_mv; /* behind the white LED, dark and lit: the battery less what the LED keeps, and nothing */
    uint16_t white_on_mv;
    uint16_t infrared_mv;  /* over the infrared LED, lit */
} eol_test;

typedef struct {
    eol_knock knock;
    eol_light light;
    uint8_t number;      /* row * columns + column; more: it has none, and says nothing */
    uint8_t group, groups; /* its own; of the table, as the bridge says */
    uint32_t own;        /* its bit in the masks of its group; 0: it has no number */
    uint8_t infrared;    /* 1: its infrared LED shines */
    uint8_t by_itself, peak, each;
    uint16_t decay_ms;
    uint16_t millivolts; /* of the battery; 0: none */
    int8_t celsius;
    uint8_t asleep;
    uint8_t light_count, words; /* of the last order to light up; 1 when a word of its group was heard */
    uint8_t tries;       /* left of the knock that is to be told */
    uint8_t pause_ms;    /* until the next try */
    uint8_t uncounted;   /* 1: it has flashed, and the bridge may not know: it holds */
    uint8_t untold;      /* 1: no frame yet is of that flash */
    uint8_t only_lit;    /* 1: what is told is that it lit itself, and no knock */
    uint8_t order_ms;    /* in which orders are the last one */
    uint8_t settle_ms;   /* until words count that know what was told */
    uint8_t knocks;      /* so far, modulo 256 */
    uint8_t due;         /* 1: a status is to be told */
    uint8_t testing;     /* 1: it is to test itself, and then to call eol_block_tested */
    uint8_t test_tries;  /* left of what that brought */
    uint16_t test_ms;    /* since the last one */
    eol_test test;
    uint8_t was_dead, absent; /* the sensor: repeats one value when last looked at; is not there */
    uint8_t flags;
    uint16_t status_ms, silent_ms;
    uint16_t strength;
    uint32_t lit_us, onset_us;
} eol_block;

void eol_block_begin(eol_block *block, uint8_t number);

/* Take a sample that ended at `now_us`; returns what eol_knock_sample does. After EOL_KNOCK_FELT the
 * level is to be shown at once, and `eol_block_shines` to be called. */
uint8_t eol_block_sample(eol_block *block, uint32_t now_us, int16_t x, int16_t y);

/* The sensor answers, or no longer. */
void eol_block_sensor(eol_block *block, uint8_t answers);

/* The LED shines since the last EOL_KNOCK_FELT. */
void eol_block_shines(eol_block *block, uint32_t now_us);

/* Take EOL_FRAME bytes that the radio brought; whatever they are. */
void eol_block_heard(eol_block *block, const uint8_t *frame);

/* Write a frame to be sent; returns 1, or 0 when there is none. A knock's age is that at `now_us`. */
uint8_t eol_block_says(eol_block *block, uint32_t now_us, uint8_t *frame);

/* The frame was heard, or not. */
void eol_block_told(eol_block *block, uint8_t heard);

/* It has tested itself, for `testing`. */
void eol_block_tested(eol_block *block, const eol_test *test);

/* The level 0..255 now. */
uint8_t eol_block_level(const eol_block *block);

/* A millisecond has passed. */
void eol_block_tick(eol_block *block);

/* 1: it may sleep, for the detector says so, it is dark and has nothing to say. */
uint8_t eol_block_may_sleep(const eol_block *block);

/* It goes to sleep, or is awake again. */
void eol_block_sleeps(eol_block *block, uint8_t sleeps);

#ifdef __cplusplus
}
#endif
#endif
