/* SPDX-License-Identifier: Apache-2.0
 *
 * When does a block feel that it is let go? Its accelerometer's samples in, knocks out, in C99 with
 * integers only: for the microcontroller in the block, for the twin and for the tests.
 *
 *     eol_knock knock;
 *     eol_knock_begin(&knock, &EOL_KNOCK_DEFAULTS);
 *     for each sample of the sensor
 *         switch (eol_knock_sample(&knock, x, y)) {
 *         case EOL_KNOCK_FELT: light(); break;
 *         case EOL_KNOCK_TOLD: report(knock.strength, knock.age); break;
 *         case EOL_KNOCK_IDLE: sleep until the sensor wakes us; eol_knock_wake(&knock); break;
 *         }
 *
 * A block that slips keeps its acceleration for many milliseconds; what is struck rings about zero.
 * So the mean over a window counts, less the mean of the time at rest (the high-pass): a strong slip
 * is felt with its first sample, a weak one when the window is filled, ringing averages out. When
 * the block is let go is where one step explains the window best (maximum likelihood). From then on
 * the samples' sum is its speed: it is at rest again when that is gone, not where the acceleration
 * passes through zero in mid-slip; until then nothing is felt (the refractory time). A block that all
 * but stops and goes on feels as if it were let go, but gently: what is far weaker than the knocks of
 * this block usually are is lit, and not told. So are hands on the rim, and feet.
 *
 * Acceleration is in 1/16 mg: what the LIS3DH writes, left-justified in 16 bits, at +-2 g.
 */
#ifndef EOL_KNOCK_H
#define EOL_KNOCK_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    EOL_KNOCK_WINDOW = 16, /* samples: 12 ms at 1344 Hz; a power of two */
    EOL_KNOCK_TELL = 4,    /* samples after it is felt until a knock is measured: 3 ms */
    EOL_KNOCK_LEARN = 512  /* samples at the start in which nothing is felt */
};

typedef struct {
    uint16_t threshold; /* 1/16 mg that the mean over the window must exceed */
    uint16_t ratio;     /* and so many quarters of the noise (mean absolute deviation of an axis) */
    uint16_t quiet;     /* samples below half of that until it rests, if its speed is gone */
    uint16_t slow;      /* the sum of samples below which it is */
    uint16_t still;     /* samples below a quarter of that until it rests, though four times faster */
    uint16_t longest;   /* samples of stillness, or of one tilt, after which that is rest */
    uint32_t idle;      /* samples at rest until the block may sleep */
} eol_knock_config;

extern const eol_knock_config EOL_KNOCK_DEFAULTS;

enum { /* what a sample brings */
    EOL_KNOCK_NONE,
    EOL_KNOCK_FELT, /* a knock: light it */
    EOL_KNOCK_TOLD, /* `strength`, `age` and `first` are those of the knock that was felt: of each
                       but the weak ones */
    EOL_KNOCK_IDLE  /* nothing has moved for long: the block may sleep */
};

enum { EOL_KNOCK_LEARNS, EOL_KNOCK_RESTS, EOL_KNOCK_FEELS, EOL_KNOCK_MOVES }; /* `state` */

typedef struct {
    eol_knock_config config;
    uint16_t strength;  /* of the last knock, 1/16 mg */
    uint16_t age;       /* how long before the newest sample it began, 1/16 of a sample */
    uint8_t first;      /* 1: it woke the block, so its time is that of waking up */
    uint8_t state;
    uint8_t dead;       /* 1: the sensor repeats one value */
    uint8_t at;         /* of the newest sample in the window */
    uint16_t since;     /* samples in this state */
    uint16_t calm, still, loud; /* samples below half, below a quarter, above half of the threshold */
    uint16_t woken;     /* samples in which a knock still counts as that which woke the block */
    uint16_t same;      /* samples with one value */
    uint32_t rested;    /* samples at rest */
    uint32_t usual;     /* half of all knocks are stronger, 1/16 mg */
    int32_t base_x, base_y, noise; /* in 1/4096 of the unit */
    int32_t sum_x, sum_y;
    int32_t speed_x, speed_y; /* sums since the knock */
    int16_t last_x, last_y;
    int16_t x[EOL_KNOCK_WINDOW], y[EOL_KNOCK_WINDOW];
} eol_knock;

/* Start over, with a sensor of which nothing is known. */
void eol_knock_begin(eol_knock *knock, const eol_knock_config *config);

/* Take one sample; return what it brings. */
uint8_t eol_knock_sample(eol_knock *knock, int16_t x, int16_t y);

/* Go on after a sleep: the samples to come have no past. */
void eol_knock_wake(eol_knock *knock);

/* The threshold as it is now, 1/16 mg: that of the noise, where it is greater. */
uint16_t eol_knock_limit(const eol_knock *knock);

#ifdef __cplusplus
}
#endif
#endif
